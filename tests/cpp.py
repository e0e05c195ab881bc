"""The C++ wrapper: library, servers and tests, built where they are missing or older than their sources."""

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
SANITIZED = ("address", "thread")
"""Builds with sanitizers, in CMakePresets.json; one is clang's, one g++'s, both with all warnings."""


def _sources() -> Iterator[Path]:
    for crate in (ROOT / "engine").glob("*/*/"):
        if crate.parent.name != "target":
            yield from (crate / "src").rglob("*.rs")
            for pattern in ("*.rs", "Cargo.*"):
                yield from crate.glob(pattern)
    for folder in (PROJECT, ROOT / "engine" / "bindings" / "c"):
        for pattern in ("CMake*.*", "*.in", "*.h", "*.hpp", "*.c", "*.cpp"):
            yield from (path for path in folder.rglob(pattern) if BUILD not in path.parents)


def _make(folder: Path, preset: str) -> Path:
    """Build into a folder, one process at a time, as the Makefile does."""
    folder.mkdir(parents=True, exist_ok=True)
    stamp = folder / ".built"
    with (folder / ".lock").open("w") as lock:
        flock(lock, LOCK_EX)
        if not stamp.exists() or stamp.stat().st_mtime < max(path.stat().st_mtime for path in _sources()):
            cmake = shutil.which("cmake")
            assert cmake, "CMake is missing; `make test-peers` installs it"
            run([cmake, "--preset", preset], cwd=PROJECT)
            run([cmake, "--build", folder, "--parallel", "2"])
            stamp.touch()
    return folder


@cache
def build() -> Path:
    """The folder with `libswarmwright.so`, `minisim` and `minisim_plugin`."""
    return _make(BUILD, "release")


@cache
def sanitized(name: str) -> Path:
    """The folder with the example servers and `fragile`, compiled with a sanitizer."""
    build()
    return _make(BUILD / name, name)


def run(command: list[str | Path], *, seconds: float = 500, cwd: Path = ROOT) -> str:
    """Run a tool to its end; what it said."""
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=seconds, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


class CppServer(Program):
    """An example server, `minisim` when not told otherwise, or a program of one's own; ready once made.

    url: of the broker; None to leave it to the environment.
    """

    def __init__(
        self,
        url: str | None,
        *options: str,
        cwd: Path,
        server: int = 1,
        main: str | Path = "minisim",
        env: Mapping[str, str] | None = None,
    ) -> None:
        program = build() / main
        where = () if url is None else ("--broker", url)
        super().__init__(program, *where, "--id", server, *options, cwd=cwd, env=env, program=())
        try:
            self.until_error("ready")
        except BaseException:
            self.stop()
            raise
