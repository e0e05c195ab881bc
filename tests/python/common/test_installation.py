"""Where Swarmwright cannot run, one line says why and what to do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import swarmwright
from tests.conftest import environment

pytestmark = pytest.mark.slow

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


@pytest.mark.parametrize("name", ["optimize", "simulate", "compare", "callbacks", "__version__"])
def test_python_on_another_system(name: str) -> None:
    """Where modules that Python has on Linux are missing."""
    missing = "for name in ('fcntl', 'resource', 'pwd'): sys.modules[name] = None"
    code = f"import sys; sys.platform = 'win32'\n{missing}\nimport swarmwright; swarmwright.{name}"
    last = python("-c", code).stderr.splitlines()[-1]
    assert last.startswith("ImportError: Swarmwright runs on Linux, not on win32: use WSL 2")


@pytest.fixture
def foreign_engine(without_engine: dict[str, str], tmp_path: Path) -> dict[str, str]:
    """The environment of a Python whose engine is for another processor."""
    engine = Path(swarmwright._engine.__file__)
    with engine.open("rb") as file:
        head = bytearray(file.read(4096))
    head[18:20] = (0xF3).to_bytes(2, "little")  # the processor of an ELF file: RISC-V
    (tmp_path / "swarmwright" / engine.name).write_bytes(head)
    return without_engine


NOT_LOADED = "Swarmwright's engine cannot be loaded here: "


@pytest.mark.parametrize("arguments", [["--version"], ["optimize", "x.yaml"]])
def test_commands_with_the_engine_of_another_processor(
    arguments: list[str], foreign_engine: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\n")
    arguments = [str(tmp_path / one) if one == "x.yaml" else one for one in arguments]
    result = python("-m", "swarmwright", *arguments, env=foreign_engine)
    assert result.returncode == 1
    assert result.stderr.startswith(f"swarmwright: {NOT_LOADED}")
    assert "bug" not in result.stderr
    assert result.stderr.count("\n") == 1


def test_python_with_the_engine_of_another_processor(foreign_engine: dict[str, str]) -> None:
    code = "import swarmwright; swarmwright.__version__"
    assert f"UnloadableError: {NOT_LOADED}" in python("-c", code, env=foreign_engine).stderr
