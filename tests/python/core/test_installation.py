"""Where Swarmwright cannot run, one line says why and what to do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import swarmwright
from tests.conftest import environment

NO_ENGINE = "Swarmwright's engine is not installed: `make demo` builds it in a clone"


@pytest.fixture
def without_engine(tmp_path: Path) -> dict[str, str]:
    """The environment of a Python that finds all of the package but its engine."""
    package = tmp_path / "swarmwright"
    package.mkdir()
    for file in Path(swarmwright.__file__).parent.iterdir():
        if not file.name.startswith("_engine"):
            (package / file.name).symlink_to(file)
    return environment({"PYTHONPATH": str(tmp_path)})


def python(*arguments: str, env: dict[str, str] | None = None) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=env or dict(os.environ), capture_output=True, text=True, check=False)


def test_commands_without_an_engine(without_engine: dict[str, str]) -> None:
    result = python("-m", "swarmwright", "optimize", "x.yaml", env=without_engine)
    assert result.returncode == 1
    assert result.stderr.startswith(f"swarmwright: {NO_ENGINE}")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("use", ["optimize", "__version__", "Experiment.from_mapping"])
def test_python_without_an_engine(use: str, without_engine: dict[str, str]) -> None:
    code = f"import swarmwright; swarmwright.{use}({{'simulation': 'minisim'}})"
    assert f"ImportError: {NO_ENGINE}" in python("-c", code, env=without_engine).stderr


@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_another_system(system: str) -> None:
    code = (
        f"import runpy, sys; sys.platform = '{system}'; runpy.run_module('swarmwright', run_name='__main__')"
    )
    result = python("-c", code)
    assert result.returncode == 1
    assert result.stderr.startswith(f"swarmwright: Swarmwright runs on Linux, not on {system}: use WSL 2")
    assert result.stderr.count("\n") == 1
