"""Permission to execute the code that a run names, see `swarmwright.simulations.user_code.trust`."""

import site
import sysconfig
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.changes import Choice
from swarmwright.simulations.user_code.copying import CopiedPart, Copy
from swarmwright.simulations.user_code.parts import Part, read_simulation


def remember(parts: Iterable[Part]) -> None:
    """Trust the simulation and the modules in files of a run that this user makes."""
    for part in parts:
        if part.name == "simulation" or part.in_file:
            trust.remember(part.digests, str(part.origin))
            trust.remember(_list_user_files(part), str(part.origin))
            # The digest that is checked if there is no copy.
            code = {
                location: digest
                for location, digest in _list_user_files(part).items()
                if location not in part.data
            }
            trust.remember(code, str(part.origin))


def require_copy(copy: Copy, copied: CopiedPart, choice: Choice) -> None:
    """Raise InputError unless a run's copy, or the source used instead, may be executed."""
    if not choice.copied and not _list_user_files(choice.part):
        return  # an installed package
    trust.require(copied.digests, copy.main_path(copied) if choice.copied else choice.part.origin)


def require_named(simulation: str) -> None:
    """Raise InputError unless the code that a run names without a copy may be executed.

    The code of a command is its words and the files that it names. Installed packages are always trusted.
    """
    part = read_simulation(simulation)
    if part is not None and (user_files := _list_user_files(part)):
        trust.require(user_files, part.origin)


def require_file(name: str) -> None:
    """Raise InputError unless the file of a class that a run names may be executed.

    Nothing is checked if there is no file, or for a run's copy, which is checked when it is imported.
    """
    parsed = SimulationName.parse(name)
    if parsed.file is not None and parsed.file.is_file() and Copy.find_containing(parsed.file) is None:
        part = Part.from_file("", "", parsed.file)
        trust.require(part.digests, part.origin)


def trusts_file(name: str) -> bool:
    """Return whether the file of a class that a run names is trusted, without asking the user.

    Raises InputError if it cannot be read.
    """
    parsed = SimulationName.parse(name)
    if parsed.file is None or not parsed.file.is_file():
        return False
    containing = Copy.find_containing(parsed.file)
    return trust.is_trusted(
        Part.from_file("", "", parsed.file).digests if containing is None else containing[1].digests
    )


def trusts(part: Part) -> bool:
    """Return whether a part is trusted, or an installed package, without asking the user."""
    files = _list_user_files(part)
    return not files or trust.is_trusted(files) or trust.is_trusted(part.digests)


def _list_user_files(part: Part) -> dict[str, str]:
    if part.module is None:
        return part.digests
    return {location: file.digest for location, file in part.files.items() if not _is_installed(file.origin)}


def _is_installed(path: Path) -> bool:
    """Return whether a file lies in a folder of this Python's packages, whatever the folder's name."""
    path = path.resolve()
    return any(path.is_relative_to(folder) for folder in _list_installation_folders())


@cache
def _list_installation_folders() -> tuple[Path, ...]:
    folders = {sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib", "platstdlib")}
    folders |= {*site.getsitepackages(), site.getusersitepackages()}
    return tuple(Path(folder).resolve() for folder in folders if folder)
