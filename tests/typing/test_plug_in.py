"""A typed package that builds on Swarmwright passes strict type checkers."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PLUG_IN = Path(__file__).with_name("plug_in.py")


def checked(*command: str, folder: Path) -> None:
    made = subprocess.run(
        [sys.executable, "-m", *command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stdout + made.stderr


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_mypy_accepts_it(tmp_path: Path) -> None:
    shutil.copy(PLUG_IN, tmp_path)
    checked("mypy", "--strict", "--no-incremental", PLUG_IN.name, folder=tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(shutil.which("node") is None, reason="node is missing")
def test_pyright_accepts_it(tmp_path: Path) -> None:
    pytest.importorskip("pyright")
    shutil.copy(PLUG_IN, tmp_path)
    options = {
        "include": [PLUG_IN.name],
        "typeCheckingMode": "strict",
        "enableTypeIgnoreComments": False,  # those are mypy's
        "reportUnnecessaryTypeIgnoreComment": True,
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(options))
    checked("pyright", "--pythonpath", sys.executable, folder=tmp_path)
