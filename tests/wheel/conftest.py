"""The wheel that `make test-wheel` builds, in an environment of its own without compilers."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import environment

HERE = Path(__file__).parent
Installed = Callable[..., "subprocess.CompletedProcess[str]"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("SWARMWRIGHT_WHEEL"):
        return
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.skip(reason="SWARMWRIGHT_WHEEL is not set: run `make test-wheel`"))


@pytest.fixture(scope="session")
def wheel() -> Path:
    """The file."""
    return Path(os.environ["SWARMWRIGHT_WHEEL"])


@pytest.fixture(scope="session")
def home(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the environment's programs."""
    folder = tmp_path_factory.mktemp("wheel") / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    programs = folder / "bin"
    subprocess.run(
        [
            str(programs / "python"),
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-compile",
            "--only-binary=:all:",
            str(wheel),
        ],
        check=True,
        env=variables(programs),
    )
    return programs


def variables(programs: Path) -> dict[str, str]:
    """The environment of a user who has no cargo, no compiler, and no copy of the sources."""
    kept = {
        key: value for key, value in environment().items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))
    }
    return {**kept, "PATH": str(programs)}


@pytest.fixture
def installed(home: Path, tmp_path: Path) -> Installed:
    """Runs the installed `swarmwright ARGUMENTS` to its end."""

    def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [str(home / "swarmwright"), *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            env=variables(home),
            stdin=subprocess.DEVNULL,
        )

    return run
