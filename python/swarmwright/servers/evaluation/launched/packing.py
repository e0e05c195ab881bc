"""The code of a custom simulation, and of modules, as it travels to servers elsewhere."""

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
"""Of the code of modules, in that of the servers."""


def packed(
    simulation: str, modules: Sequence[str], options: LauncherOptions
) -> tuple[str, list[str], Code | None]:
    """Return what simulation and modules are called where their code is the working folder, and the code.

    There is no code for what is installed with Swarmwright or another package. Each module in a file has a
    folder with what it imports, named by their SHA-256, so that files of the same name do not meet.

    Raises:
        InputError: a file cannot be read, or there are too many.
    """
    parsed_modules = [SimulationName.parse(module) for module in modules]
    in_files = any(parsed.file is not None for parsed in parsed_modules)
    name, files, programs = _simulation(simulation, options, in_files=in_files)
    names = []
    for module, parsed in zip(modules, parsed_modules, strict=True):
        if parsed.file is None:
            names.append(module)
            continue
        part = _part(parsed.file)
        folder = "" if options.code is not None else f"{_FOLDER}{trust.digest_of(part.digests)[:16]}/"
        names.append(parsed.in_file(f"{folder}{part.main}"))
        files.update({f"{folder}{place}": source.data for place, source in part.files.items()})
    size = sum(map(len, files.values()))
    if size > parts.LARGEST_BYTES:
        raise parts.make_size_error(size)
    travels = files and options.code is None
    return name, names, Code.of(files, programs) if travels else None


def _part(path: Path) -> Part:
    """Return the source of a file; of a run's copy that of the original, as long as it is the same."""
    held = Copy.find_containing(path)
    return Part.from_file("", path.name, path) if held is None else choose(*held).part


def _simulation(
    simulation: str, options: LauncherOptions, *, in_files: bool
) -> tuple[str, dict[str, bytes], set[str]]:
    """Return what the simulation is called, its files by their place, and which of them are programs.

    in_files: whether there is code of modules besides.
    """
    name, part = _source(simulation) if is_python(simulation) else (simulation, None)
    if part is None:
        _refuse_files(options, in_files=in_files)
        return simulation, {}, set()
    if options.code is not None:
        return name, {}, set()
    files = {place: source.data for place, source in part.files.items()}
    programs = {place for place, source in part.files.items() if os.access(source.origin, os.X_OK)}
    home = parts.get_home(part)
    for path in parts.find_named_files(home, options.files):
        files.setdefault(path.relative_to(home).as_posix(), parts.read_file(path))
    return name, files, programs


def _source(simulation: str) -> tuple[str, Part | None]:
    """Return what a simulation is called where its code is the working folder, and its source.

    Of a run's copy that is the original, as long as it is the same: files that the run does not keep are
    beside it.
    """
    parsed = SimulationName.parse(simulation)
    environment = find_environment_copy(simulation)
    if environment is not None:
        copy, kept = environment
        return kept.component, choose(copy, kept).part
    held = None if parsed.file is None else Copy.find_containing(parsed.file.absolute())
    part = (
        read_simulation(simulation) if held is None or _is_other(simulation, held[1]) else choose(*held).part
    )
    if part is None or parsed.file is None:
        return simulation, part
    return parsed.in_file(part.main if part.module is None else part.module), part


def _is_other(simulation: str, kept: CopiedPart) -> bool:
    """Whether a command is another one than the run's, whose files it uses."""
    if not is_command(simulation):
        return False
    now = read_simulation(simulation)
    return now is None or now.digests.get(kept.main) != kept.digests[kept.main]


def check_here(simulation: str, options: LauncherOptions) -> None:
    """Raise InputError for options about copied code, which servers on this machine do not use."""
    if options.code is not None:
        raise InputError(
            f"servers: code: servers of {options.launcher} run on this machine, with the simulation's own "
            "files; leave it out"
        )
    if not is_python(simulation):
        _refuse_files(options, in_files=False)


def _refuse_files(options: LauncherOptions, *, in_files: bool) -> None:
    """Raise InputError when files or code are named, and there is no code that could be copied.

    in_files: whether there is code of modules.
    """
    if options.files or (options.code is not None and not in_files):
        key = "files" if options.files else "code"
        raise InputError(
            f"servers: {key}: the simulation is installed, so no code of it is copied; leave it out"
        )
