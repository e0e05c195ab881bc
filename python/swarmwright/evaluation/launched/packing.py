"""The code of a custom simulation as it travels to servers elsewhere."""

import os
from collections.abc import Sequence
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.simulation_names import SimulationName, is_python
from swarmwright.launchers import Code, LauncherOptions
from swarmwright.user_code.parts import of_simulation

LARGEST = 1 << 28
"""Bytes of all files."""


def packed(simulation: str, options: LauncherOptions) -> tuple[str, Code | None]:
    """Return what the simulation is called where its code is the working folder, and the code.

    There is no code for what is installed with Swarmwright or another package.

    Raises:
        InputError: a file cannot be read, or there are too many.
    """
    part = of_simulation(simulation) if is_python(simulation) else None
    if part is None:
        _refuse_files(options)
        return simulation, None
    parsed = SimulationName.parse(simulation)
    name = parsed.in_file(part.main) if parsed.file is not None else simulation
    if options.code is not None:
        return name, None
    files = {place: source.data for place, source in part.files.items()}
    programs = {place for place, source in part.files.items() if os.access(source.origin, os.X_OK)}
    home = part.origin.parents[len(Path(part.main).parts) - 1]
    for path in _beside(home, options.files):
        files.setdefault(path.relative_to(home).as_posix(), _read(path))
    size = sum(map(len, files.values()))
    if size > LARGEST:
        raise InputError(
            f"servers: files: {size >> 20} MiB are more than {LARGEST >> 20}; copy them to the servers' "
            "machines and name their folder with the option code"
        )
    return name, Code.of(files, programs)


def _refuse_files(options: LauncherOptions) -> None:
    if options.files or options.code is not None:
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
