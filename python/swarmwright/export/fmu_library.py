"""The shared library of an FMU, which the C compiler (CC) makes of its sources."""

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

from swarmwright.common import archives
from swarmwright.common.errors import InputError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.export._base import Files
from swarmwright.export.c import LANGUAGE
from swarmwright.export.fmu_parts import zipped
from swarmwright.export.programs import command, run, standard_option

_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "mingw": ("windows", ".dll")}
_MACHINES = """\
#if defined __x86_64__ && __SIZEOF_POINTER__ == 8
machine: x86_64
#elif defined __i386__
machine: x86
#elif defined __aarch64__ && __SIZEOF_POINTER__ == 8
machine: aarch64
#elif defined __riscv && __riscv_xlen == 64
machine: riscv64
#endif
"""
"""Preprocessed, this is the machine: options such as -m32 change it, and not what -dumpmachine says."""
_TIME_OUT_S = 120
_LARGEST_FILE_BYTES = 1 << 26
"""Of a file in an FMU; those that Swarmwright writes have some kilobytes, a library some hundreds."""
_SOURCES, _BINARIES = "sources/", "binaries/"


def library(prefix: str, sources: Mapping[str, bytes], fmi: str) -> tuple[str, bytes]:
    """Return the place of the shared library in the archive, and the library.

    Raises InputError where there is no C compiler, or FMI has no name for what it compiles for, RunError when
    it finds fault with a source.
    """
    compiler = command(
        "CC", ("cc", "gcc", "clang"), "apt install gcc", needed_by="an FMU holds a library, which"
    )
    machine, system, ending = _platform(compiler)
    with TemporaryFolder("fmu") as folder:
        for name, data in sources.items():
            (folder / name).write_bytes(data)
        standard = standard_option(compiler, LANGUAGE.standard)
        options = [*standard, "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]
        file = f"{prefix}{ending}"
        words = [*options, "-DSWARMWRIGHT_CONTRACT_OFF", "-o", file, f"{prefix}.c", f"{prefix}_fmu.c"]
        run([*compiler, *words], folder, "the C compiler", during="the FMU's library")
        made = (folder / file).read_bytes()
    if fmi == "3.0":
        return f"{_BINARIES}{machine}-{system}/{file}", made
    bits = "32" if machine == "x86" else "64"
    return f"{_BINARIES}{'win' if system == 'windows' else system}{bits}/{file}", made


def add_library(file: Path, prefix: str, fmi: str) -> None:
    """Compile the sources of an FMU without a library, and put this into the archive.

    Raises as `library`, and InputError where the FMU, which may be from a bundle, is damaged or too large.
    """
    with archives.opened(file, "an FMU") as archive:
        inside: Files = {
            name: archives.content(archive, file, name, _LARGEST_FILE_BYTES) for name in archive.namelist()
        }
    if any(name.startswith(_BINARIES) for name in inside):
        return
    sources = {
        name.removeprefix(_SOURCES): data
        for name, data in inside.items()
        if name.startswith(_SOURCES) and isinstance(data, bytes)
    }
    place, made = library(prefix, sources, fmi)
    file.write_bytes(zipped({**inside, place: made}))


def _platform(compiler: list[str]) -> tuple[str, str, str]:
    """Return machine and system as FMI 3.0 names them, and how libraries end there."""
    triple = _compiler_output([*compiler, "-dumpmachine"]).strip()
    preprocessed = _compiler_output([*compiler, "-E", "-P", "-x", "c", "-"], _MACHINES)
    machine = re.search(r"^machine: (\w+)$", preprocessed, re.MULTILINE)
    system = next((found for word, found in _SYSTEMS.items() if word in triple), None)
    if machine is None or system is None:
        raise InputError(
            f"{' '.join(compiler)}: compiles for {triple or 'an unknown machine'}, which FMI has no name "
            "for; name another compiler with CC"
        )
    return machine[1], *system


def _compiler_output(words: list[str], text: str = "") -> str:
    """Return what a compiler prints about itself."""
    try:
        return subprocess.run(
            words,
            input=text,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_TIME_OUT_S,
            check=False,
        ).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"{' '.join(words)}: does not say what it compiles for: {error}") from None
