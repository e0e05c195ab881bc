"""The C++ wrapper: library and example servers, built where they are missing or older than their sources."""

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from fcntl import LOCK_EX, flock
from functools import cache
from pathlib import Path

from tests.conftest import ROOT
from tests.system.processes import Program

PROJECT = ROOT / "wrappers" / "cpp"
BUILD = PROJECT / "build"
SANITIZED = {"address": ("clang++", "clang", "address,undefined"), "thread": ("g++", "gcc", "thread")}
"""By sanitizer: the compilers and their option. Each compiler's turn comes, with all warnings."""


def _sources() -> Iterator[Path]:
    for crate in (ROOT / "engine").glob("*/"):
        if crate.name != "target":
            yield from crate.rglob("*.rs")
    for folder in (PROJECT, ROOT / "engine" / "c"):
        for pattern in ("CMakeLists.txt", "*.in", "*.toml", "*.h", "*.hpp", "*.cpp"):
            yield from (path for path in folder.rglob(pattern) if "build" not in path.parts[:-1])


def _older(folder: Path) -> bool:
    """Whether a build is older than what it is made of; if so it is to be made."""
    stamp = folder / ".tested"
    return not stamp.exists() or stamp.stat().st_mtime < max(path.stat().st_mtime for path in _sources())


def _make(folder: Path, *options: str) -> Path:
    """Build into a folder, one process at a time."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as lock:
        flock(lock, LOCK_EX)
        if _older(folder):
            cmake = shutil.which("cmake")
            assert cmake, "CMake is missing; `make test` installs it"
            run([cmake, "-S", PROJECT, "-B", folder, *options])
            run([cmake, "--build", folder, "--parallel", "2"])
            (folder / ".tested").touch()
    return folder


@cache
def build() -> Path:
    """The folder with `libswarmwright.so`, `minisim` and `minisim_plugin`."""
    return _make(BUILD, "-DCMAKE_BUILD_TYPE=Release")


@cache
def sanitized(name: str) -> Path:
    """The folder with the example servers, the tests and `fragile`, compiled with a sanitizer."""
    cpp, c, option = SANITIZED[name]
    assert shutil.which(cpp), f"{cpp} is missing; `make test` installs it"
    return _make(
        BUILD / name,
        "-DCMAKE_BUILD_TYPE=Debug",
        f"-DCMAKE_CXX_COMPILER={cpp}",
        f"-DCMAKE_C_COMPILER={c}",
        f"-DSWARMWRIGHT_SANITIZE={option}",
        f"-DSWARMWRIGHT_LIBRARY_DIR={build()}",
        "-DSWARMWRIGHT_TESTS=ON",
    )


def run(command: list[str | Path], *, seconds: float = 500, cwd: Path = ROOT) -> str:
    """Run a tool to its end; what it said."""
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=seconds, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


class CppServer(Program):
    """An example server, `minisim` when not told otherwise, or a program of one's own; ready once made."""

    def __init__(
        self,
        url: str,
        *options: str,
        cwd: Path,
        server: int = 1,
        main: str | Path = "minisim",
        env: Mapping[str, str] | None = None,
    ) -> None:
        self.cwd = cwd
        super().__init__(
            build() / main, "--broker", url, "--id", server, *options, cwd=cwd, env=env, program=()
        )
        try:
            self.until_error("ready")
        except BaseException:
            self.stop()
            raise


LIBRARY_PATH = "LD_LIBRARY_PATH"


def library_path() -> dict[str, str]:
    """The environment in which programs that were linked elsewhere find the library."""
    return {LIBRARY_PATH: os.pathsep.join(filter(None, [str(build()), os.environ.get(LIBRARY_PATH, "")]))}
