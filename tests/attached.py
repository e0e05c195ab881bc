"""Simulators that are in no registry: where they are installed, and what is built for them here.

`SWARMWRIGHT_ARGOS` and `SWARMWRIGHT_STAGE` name the folders where they were installed; else they are searched
where the system has them.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fcntl import LOCK_EX, flock
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.cpp import build as build_cpp
from tests.cpp import run
from tests.system.processes import Program

INSTALLED = ROOT / "wrappers" / "cpp" / "build" / "installed"
"""The wrapper for C++, as users install it."""


def _prefix(variable: str, header: str) -> Path | None:
    named = os.environ.get(variable)
    for folder in [Path(named)] if named else [Path("/usr/local"), Path("/usr")]:
        if any(folder.glob(f"include/{header}")):
            return folder.resolve()
    return None


@dataclass(frozen=True)
class Simulator:
    """prefix: where it is installed, if it is. program: runs files. file: an experiment of the tests."""

    name: str
    variable: str
    prefix: Path | None
    program: str
    options: tuple[str, ...]
    libraries: str
    plugins: str
    file: Path

    @property
    def needed(self) -> pytest.MarkDecorator:
        """Skips tests where it is not installed."""
        why = f"{self.name} is not installed; {self.variable} names the folder where it is"
        return pytest.mark.skipif(self.prefix is None, reason=why)

    @property
    def build(self) -> Path:
        """The folder with the server and the plug-in."""
        return ROOT / "wrappers" / self.name.lower() / "build"

    def environment(self) -> dict[str, str]:
        """What it needs to find its own libraries, and our plug-in."""
        return {"LD_LIBRARY_PATH": f"{self.prefix}/{self.libraries}", self.plugins: str(self.build)}


ARGOS = Simulator(
    "ARGoS",
    "SWARMWRIGHT_ARGOS",
    _prefix("SWARMWRIGHT_ARGOS", "argos3/core/config.h"),
    "argos3",
    ("-n", "-c"),
    "lib/argos3",
    "ARGOS_PLUGIN_PATH",
    ROOT / "tests" / "argos" / "gather.argos",
)
STAGE = Simulator(
    "Stage",
    "SWARMWRIGHT_STAGE",
    _prefix("SWARMWRIGHT_STAGE", "Stage-*/stage.hh"),
    "stage",
    ("-g",),
    "lib",
    "STAGEPATH",
    ROOT / "tests" / "stage" / "gather.world",
)


@cache
def build(simulator: Simulator) -> Path:
    """The folder with its server and plug-in, built where they are missing or older than their sources."""
    library = build_cpp()
    folder = simulator.build
    folder.mkdir(parents=True, exist_ok=True)
    stamp = folder / ".built"
    sources = [
        path
        for source in (folder.parent, ROOT / "wrappers" / "cpp" / "include")
        for path in source.rglob("*.*")
        if folder not in path.parents and path.is_file()
    ]
    with (library / ".installing").open("w") as lock:
        flock(lock, LOCK_EX)
        newest = max(path.stat().st_mtime for path in [*sources, library / "libswarmwright.so.1"])
        if not stamp.exists() or stamp.stat().st_mtime < newest:
            run(["cmake", "--install", library, "--prefix", INSTALLED])
            run(configure(simulator, folder.parent, folder))
            run(["cmake", "--build", folder, "--parallel", "2"])
            stamp.touch()
    return folder


def configure(simulator: Simulator, source: Path, folder: Path) -> list[str | Path]:
    """The command that prepares a build against the wrapper and the simulator."""
    prefixes = f"-DCMAKE_PREFIX_PATH={INSTALLED};{simulator.prefix}"
    return ["cmake", "-S", source, "-B", folder, "-DCMAKE_BUILD_TYPE=Release", prefixes]


class Attached(Program):
    """A simulator with the plug-in, ready once made."""

    def __init__(
        self,
        simulator: Simulator,
        url: str,
        server: int,
        *,
        cwd: Path,
        file: Path | None = None,
        env: Mapping[str, str] | None = None,
        ready: bool = True,
    ) -> None:
        build(simulator)
        assert simulator.prefix is not None
        env = {
            **simulator.environment(),
            "SWARMWRIGHT_BROKER": url,
            "SWARMWRIGHT_ID": str(server),
            **(env or {}),
        }
        program = simulator.prefix / "bin" / simulator.program
        super().__init__(program, *simulator.options, file or simulator.file, cwd=cwd, env=env, program=())
        if ready:
            try:
                self.until_error("ready")
            except BaseException:
                self.stop()
                raise


def memory(pid: int) -> int:
    """Memory that a process has now, kB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    found = re.search(r"^VmRSS:\s+(\d+) kB", status, re.MULTILINE)
    assert found, status
    return int(found[1])


def script(simulator: Simulator, folder: Path) -> Path:
    """A program that starts it with the plug-in: BROKER ID."""
    build(simulator)
    path = folder / f"{simulator.name}.sh"
    exports = "\n".join(f"export {key}='{value}'" for key, value in simulator.environment().items())
    options = " ".join(simulator.options)
    path.write_text(
        f"#!/bin/sh\n{exports}\nexport SWARMWRIGHT_BROKER=$1 SWARMWRIGHT_ID=$2\n"
        f"exec {simulator.prefix}/bin/{simulator.program} {options} {simulator.file} > /dev/null\n"
    )
    path.chmod(0o755)
    return path
