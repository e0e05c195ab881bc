"""The wheel that `make wheel` or `make test-wheel` builds, in an environment of its own without compilers.

It is installed by the commands of docs/how-to/install.md. Nothing here imports swarmwright, which need not be
compiled for these tests.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy.release import sums
from tests.conftest import ROOT, environment

HERE = Path(__file__).parent
PAGE = ROOT / "docs/how-to/install.md"
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
def processor(wheel: Path) -> str:
    """What the wheel is for, as `uname -m` names it."""
    return "aarch64" if wheel.stem.endswith("_aarch64") else "x86_64"


@pytest.fixture(scope="session")
def home(wheel: Path, processor: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the environment's programs."""
    folder = tmp_path_factory.mktemp("wheel")
    if processor != platform.machine():
        return emulated(wheel, Path(os.environ["SWARMWRIGHT_ARM64"]), folder)
    shutil.copy(wheel, folder)
    sums(folder, wheel.name.split("-")[1])
    tools = folder / "tools"
    tools.mkdir()
    (tools / "python3").symlink_to(Path(sys.executable).resolve())
    for name in ("sha256sum", "uname"):
        (tools / name).symlink_to(shutil.which(name) or name)
    commands = re.search(r"^```bash shown\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert commands
    subprocess.run(
        [shutil.which("bash") or "bash", "-euo", "pipefail", "-c", commands[1]],
        check=True,
        cwd=folder,
        env={**variables(tools), "PIP_ONLY_BINARY": ":all:", "PIP_NO_COMPILE": "1", "PIP_QUIET": "1"},
    )
    return folder / "swarmwright" / "bin"


def emulated(wheel: Path, arm64: Path, folder: Path) -> Path:
    """The same programs in an arm64 Python that qemu runs, with the libraries of `make test-arm64`."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    programs = folder / "bin"
    programs.mkdir()
    # Python takes its own path from argument 0: processes that it starts are emulated as well.
    python = f"""#!/bin/sh
export PYTHONHOME={arm64}/root/usr PYTHONPATH={folder}/site:{arm64}/site
exec {shutil.which("qemu-aarch64")} -L {arm64}/root -0 "$0" {arm64}/root/usr/bin/python3.11 "$@"
"""
    program = f"""#!/bin/sh
exec {programs}/python -m swarmwright "$@"
"""
    for name, text in (("python", python), ("swarmwright", program)):
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
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
