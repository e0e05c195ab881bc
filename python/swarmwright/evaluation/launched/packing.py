"""The code of a custom simulation, and of modules, as it travels to servers elsewhere."""

import os
from collections.abc import Sequence
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.simulation_names import SimulationName, is_python
from swarmwright.launchers import Code, LauncherOptions
from swarmwright.user_code import trust
from swarmwright.user_code.changes import choose
from swarmwright.user_code.copying import Copy
from swarmwright.user_code.parts import Part, of_simulation

LARGEST = 1 << 28
"""Bytes of all files."""
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
    if size > LARGEST:
        raise InputError(
            f"servers: files: {size >> 20} MiB are more than {LARGEST >> 20}; copy them to the servers' "
            "machines and name their folder with the option code"
        )
    travels = files and options.code is None
    return name, names, Code.of(files, programs) if travels else None


def _part(path: Path) -> Part:
    """Return the source of a file; of a run's copy that of the original, as long as it is the same."""
    held = Copy.holding(path)
    return Part.of_file("", path.name, path) if held is None else choose(*held).part


def _simulation(
    simulation: str, options: LauncherOptions, *, in_files: bool
) -> tuple[str, dict[str, bytes], set[str]]:
    """Return what the simulation is called, its files by their place, and which of them are programs.

    in_files: whether there is code of modules besides.
    """
    part = of_simulation(simulation) if is_python(simulation) else None
    if part is None:
        _refuse_files(options, in_files=in_files)
        return simulation, {}, set()
    parsed = SimulationName.parse(simulation)
    name = parsed.in_file(part.main) if parsed.file is not None else simulation
    if options.code is not None:
        return name, {}, set()
    files = {place: source.data for place, source in part.files.items()}
    programs = {place for place, source in part.files.items() if os.access(source.origin, os.X_OK)}
    home = part.origin.parents[len(Path(part.main).parts) - 1]
    for path in _beside(home, options.files):
        files.setdefault(path.relative_to(home).as_posix(), _read(path))
    return name, files, programs


def _refuse_files(options: LauncherOptions, *, in_files: bool) -> None:
    if options.files or (options.code is not None and not in_files):
        key = "files" if options.files else "code"
        raise InputError(
            f"servers: {key}: the simulation is installed, so no code of it is copied; leave it out"
        )


def _beside(home: Path, patterns: Sequence[str]) -> list[Path]:
    found: set[Path] = set()
    for pattern in patterns:
        if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
            raise InputError(f"servers: files: {pattern} must lie in {home}, beside the simulation")
        matches = [path for path in home.glob(pattern) if path.is_file()]
        if not matches:
            raise InputError(f"servers: files: there is no file {pattern} in {home}")
        found.update(matches)
    return sorted(found)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"servers: files: {path}: cannot be read: {error.strerror}") from error
