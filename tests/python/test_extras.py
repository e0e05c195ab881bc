"""What is optional may be missing: what needs it says so, and all else works."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

EXTRAS = (
    "paho",
    "msgpack",
    "pyarrow",
    "mlflow",
    "keyring",
    "gymnasium",
    "mujoco",
)
PROGRAM = f"""
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name in {EXTRAS!r} else found(name, package)
from swarmwright import cli
sys.exit(cli.run(sys.argv[1:]))
"""


LEFT_OUT = ("matplotlib", "PIL", "scipy")
"""What the container image leaves out."""


def program(
    *arguments: str, folder: Path, missing: tuple[str, ...] = EXTRAS
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", PROGRAM.replace(repr(EXTRAS), repr(missing)), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=50,
        cwd=folder,
    )


def test_the_conformance_kit_without_its_libraries(tmp_path: Path) -> None:
    done = program("conformance", "server", "--exec", "true", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "swarmwright: the conformance kit needs paho-mqtt and msgpack: "
        "pip install 'swarmwright[conformance]'\n"
    )


@pytest.mark.slow
def test_all_else_works_without_extras(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {kind: nnga, population: 10, generations: 2}\n"
    )
    for command in (
        ["optimize", "x.yaml", "--out", "run"],
        ["plot", "run"],
        ["draw", "run"],
        ["replay", "run", "--save", "x.gif"],
        ["runs", "show", "run"],
    ):
        done = program(*command, folder=tmp_path)
        assert (done.returncode, done.stderr) == (0, ""), command
    done = program("runs", "export", "run", "x.parquet", folder=tmp_path)
    assert "pip install 'swarmwright[parquet]'" in done.stderr
    assert json.loads((tmp_path / "run" / "best.json").read_text())["candidate"] < 10


@pytest.mark.timeout(200)  # six programs, one after another
def test_a_run_needs_no_libraries_for_figures(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {kind: nnga, population: 10, generations: 2}\n"
    )
    for command in (
        ["optimize", "x.yaml", "--out", "run"],
        ["evaluate", "run", "--episodes", "3"],
        ["replay", "run", "--save", "best.html"],
        ["export", "run", "--to", "c", "--output", "c"],
    ):
        done = program(*command, folder=tmp_path, missing=LEFT_OUT)
        assert (done.returncode, done.stderr) == (0, ""), command
    for command, package in (
        (["plot", "run"], "matplotlib"),
        (["replay", "run", "--save", "best.gif"], "pillow"),
    ):
        done = program(*command, folder=tmp_path, missing=LEFT_OUT)
        assert done.returncode == 2
        assert done.stderr == f"swarmwright: the package {package} is missing: pip install {package}\n"
