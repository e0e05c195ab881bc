"""Whether the code that a run names may be executed: see `swarmwright.simulations.user_code.trust`."""

import site
import sysconfig
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.changes import Choice
from swarmwright.simulations.user_code.copying import Copy, Kept
from swarmwright.simulations.user_code.parts import Part, of_simulation


def remember(parts: Iterable[Part]) -> None:
    """Trust the simulation, and modules in files, among the source of a run that this user makes."""
    for part in parts:
        if part.name == "simulation" or part.in_file:
            trust.remember(part.digests, str(part.origin))
            trust.remember(_own(part), str(part.origin))
            # What is asked for where there is no copy.
            code = {place: digest for place, digest in _own(part).items() if place not in part.data}
            trust.remember(code, str(part.origin))


def require_copy(copy: Copy, kept: Kept, choice: Choice) -> None:
    """Raise InputError unless a run's copy may be executed, or what is used in its place."""
    if not choice.copied and not _own(choice.part):
        return  # an installed package
    trust.require(kept.digests, copy.place(kept) if choice.copied else choice.part.origin)


def require_named(simulation: str) -> None:
    """Raise InputError unless the code that a run names, and has no copy of, may be executed.

    Of a command these are its words and the files that it names; installed packages need no trust.
    """
    part = of_simulation(simulation)
    if part is not None and (own := _own(part)):
        trust.require(own, part.origin)


def require_file(name: str) -> None:
    """Raise InputError unless the file of a class that a run names may be executed.

    Nothing is checked for a run's copy, which is where it is imported, or where there is no file.
    """
    parsed = SimulationName.parse(name)
    if parsed.file is not None and parsed.file.is_file() and Copy.holding(parsed.file) is None:
        part = Part.of_file("", "", parsed.file)
        trust.require(part.digests, part.origin)


def trusts_file(name: str) -> bool:
    """Whether the file of a class that a run names may be executed, without asking anybody.

    Raises InputError when it cannot be read.
    """
    parsed = SimulationName.parse(name)
    if parsed.file is None or not parsed.file.is_file():
        return False
    held = Copy.holding(parsed.file)
    return trust.is_trusted(Part.of_file("", "", parsed.file).digests if held is None else held[1].digests)


def _own(part: Part) -> dict[str, str]:
    if part.module is None:
        return part.digests
    return {place: file.digest for place, file in part.files.items() if not _is_installed(file.origin)}


def _is_installed(path: Path) -> bool:
    """Whether a file lies where this Python's packages are installed; folders' names do not count."""
    path = path.resolve()
    return any(path.is_relative_to(place) for place in _places())


@cache
def _places() -> tuple[Path, ...]:
    known = {sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib", "platstdlib")}
    known |= {*site.getsitepackages(), site.getusersitepackages()}
    return tuple(Path(place).resolve() for place in known if place)
