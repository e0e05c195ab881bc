"""Packing of the code of custom simulations and modules for remote servers."""

import os
from collections.abc import Sequence
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_command, is_python
from swarmwright.servers.launchers import Code, LauncherOptions
from swarmwright.simulations.names import find_environment_copy
from swarmwright.simulations.user_code import parts, trust
from swarmwright.simulations.user_code.changes import choose
from swarmwright.simulations.user_code.copying import CopiedPart, Copy
from swarmwright.simulations.user_code.parts import Part, read_simulation

_FOLDER = "modules/"
"""Folder of the code of modules within the servers' code."""


def pack_code(
    simulation: str, modules: Sequence[str], options: LauncherOptions
) -> tuple[str, list[str], Code | None]:
    """Pack the code; return the names of simulation and modules relative to it, and the code.

    Installed packages are not packed. Each module in a file gets a folder with its imports, named by their
    SHA-256, so that files of the same name do not collide.

    Raises:
        InputError: a file cannot be read, or there are too many.
    """
    parsed_modules = [SimulationName.parse(module) for module in modules]
    in_files = any(parsed.file is not None for parsed in parsed_modules)
    name, files, programs = _pack_simulation(simulation, options, in_files=in_files)
    names = []
    for module, parsed in zip(modules, parsed_modules, strict=True):
        if parsed.file is None:
            names.append(module)
            continue
        part = _load_part(parsed.file)
        folder = "" if options.code is not None else f"{_FOLDER}{trust.digest_of(part.digests)[:16]}/"
        names.append(parsed.with_file(f"{folder}{part.main}"))
        files.update({f"{folder}{path}": source.data for path, source in part.files.items()})
    size = sum(map(len, files.values()))
    if size > parts.LARGEST_BYTES:
        raise parts.make_size_error(size)
    travels = files and options.code is None
    return name, names, Code.from_files(files, programs) if travels else None


def _load_part(path: Path) -> Part:
    """Return the source of a file; for a run's copy the original, if it is unchanged."""
    held = Copy.find_containing(path)
    return Part.from_file("", path.name, path) if held is None else choose(*held).part


def _pack_simulation(
    simulation: str, options: LauncherOptions, *, in_files: bool
) -> tuple[str, dict[str, bytes], set[str]]:
    """Return the simulation's name, its files by path, and which of them are programs.

    in_files: whether modules in files are packed, too.
    """
    name, part = _find_source(simulation) if is_python(simulation) else (simulation, None)
    if part is None:
        _refuse_files(options, in_files=in_files)
        return simulation, {}, set()
    if options.code is not None:
        return name, {}, set()
    files = {name_in_code: source.data for name_in_code, source in part.files.items()}
    programs = {
        name_in_code for name_in_code, source in part.files.items() if os.access(source.origin, os.X_OK)
    }
    home = parts.get_home(part)
    for path in parts.find_named_files(home, options.files):
        files.setdefault(path.relative_to(home).as_posix(), parts.read_file(path))
    return name, files, programs


def _find_source(simulation: str) -> tuple[str, Part | None]:
    """Return a simulation's name relative to its code, and its source.

    For a run's copy, use the original if it is unchanged, as it has further files beside it.
    """
    parsed = SimulationName.parse(simulation)
    environment = find_environment_copy(simulation)
    if environment is not None:
        copy, record = environment
        return record.component, choose(copy, record).part
    held = None if parsed.file is None else Copy.find_containing(parsed.file.absolute())
    part = (
        read_simulation(simulation) if held is None or _differs(simulation, held[1]) else choose(*held).part
    )
    if part is None or parsed.file is None:
        return simulation, part
    return parsed.with_file(part.main if part.module is None else part.module), part


def _differs(simulation: str, record: CopiedPart) -> bool:
    """Whether a command differs from the run's, although it uses the run's files."""
    if not is_command(simulation):
        return False
    now = read_simulation(simulation)
    return now is None or now.digests.get(record.main) != record.digests[record.main]


def check_local_options(simulation: str, options: LauncherOptions) -> None:
    """Raise InputError for options about copied code, which local servers do not use."""
    if options.code is not None:
        raise InputError(
            f"servers: code: has no effect, as servers of {options.launcher} run on this machine with the "
            "original files; leave it out"
        )
    if not is_python(simulation):
        _refuse_files(options, in_files=False)


def _refuse_files(options: LauncherOptions, *, in_files: bool) -> None:
    """Raise InputError if files or code are configured but there is no code to copy.

    in_files: whether modules in files are packed.
    """
    if options.files or (options.code is not None and not in_files):
        key = "files" if options.files else "code"
        raise InputError(
            f"servers: {key}: has no effect, as the simulation is installed and not copied; leave it out"
        )
