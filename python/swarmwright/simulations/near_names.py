"""What was probably meant by the name of a simulation that is not known here."""

import ast
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from swarmwright.common.simulation_names import LIBRARIES, SIMULATORS, simulator_file
from swarmwright.common.suggestions import did_you_mean, nearest
from swarmwright.simulations import catalogue
from swarmwright.simulations.loading import classes_of_file


def class_missing(name: str, folder: Path | None = None) -> str:
    """Say that a class has to be named, and which ones the file has.

    Args:
        name: the path of the file, as it was given.
        folder: that it is relative to; default: the working folder.

    Raises InputError when there is no such file, or it cannot be imported.
    """
    classes = classes_of_file((folder or Path()) / name)
    there = (
        f"{name} has {', '.join(classes)}" if classes else f"{name} has no subclass of swarmwright.Simulation"
    )
    write = f": write {name}:{classes[0]}" if classes else ""
    return f"a simulation in Python is named by its file and its class; {there}{write}"


_MOST_FILES = 200
"""Files of a folder in which classes are looked for."""
_LARGEST_FILE = 1 << 20
"""Bytes."""


def unknown_simulation(name: str, folder: Path | None = None) -> str:
    """Say that no simulation has this title here, with the name that was probably meant, and all titles.

    folder: in which classes are looked for, without importing them; default: the working folder.
    """
    of_a_simulator = simulator_file(name)
    if of_a_simulator is not None:
        return f"{name!r} {of_a_simulator}"
    meant = _meant(name, folder or Path())
    if meant is None and name in SIMULATORS:
        return f"{name!r} is not built in: servers of another simulator offer it, see {SIMULATORS[name]}"
    near = alike(name) or ";" if meant is None else f"; did you mean {meant!r}?"
    return f"unknown simulation {name!r}{near} available: {', '.join(catalogue.titles())}"


def alike(simulation: str) -> str:
    """Return "; did you mean 'x'?" for a title near a known one: built in, or of another simulator.

    Empty for a title that is known, and where none is near.
    """
    known = (*catalogue.titles(), *SIMULATORS)
    return "" if catalogue.is_here(simulation) or simulation in known else did_you_mean(simulation, known)


def no_experiment(path: Path) -> str | None:
    """Say what a file is instead of an experiment; None where its name does not tell."""
    of_a_simulator = simulator_file(path.name)
    if of_a_simulator is not None:
        return f"{path}: {of_a_simulator}"
    if path.suffix != ".py":
        return None
    found = next((f"{path.name}:{name}" for name, _ in _classes(path)), f"{path.name}:CLASS")
    return (
        f"{path}: is a program in Python, not an experiment; write an experiment file with the line "
        f"'simulation: {found}'"
    )


def _meant(name: str, folder: Path) -> str | None:
    """Return the whole name of a class or an environment of which a name is a part; None without one."""
    library, _, rest = name.partition(":")
    near = nearest(library, LIBRARIES)
    if rest and near is not None:
        return f"{near}:{rest}"
    for path in sorted(folder.glob("*.py"))[:_MOST_FILES]:
        for kind, title in _classes(path):
            if name in {kind, title}:
                return f"{path.name}:{kind}"
    return f"gymnasium:{name}" if _in_gymnasium(name) else None


def _in_gymnasium(name: str) -> bool:
    """Whether Gymnasium has an environment of this name."""
    if find_spec("gymnasium") is None:
        return False
    with suppress(Exception):  # a damaged installation is no reason for another message
        from gymnasium import registry  # noqa: PLC0415 - only for this message

        return name in registry
    return False


def _classes(path: Path) -> Iterator[tuple[str, str]]:
    """Yield name and `title` of the derived classes of a file; none of one that cannot be read."""
    with suppress(OSError, SyntaxError, ValueError):
        if path.stat().st_size > _LARGEST_FILE:
            return
        for statement in ast.parse(path.read_bytes()).body:
            if isinstance(statement, ast.ClassDef) and statement.bases:
                yield statement.name, _title(statement)


def _title(kind: ast.ClassDef) -> str:
    """Return what a class assigns to `title`, empty where that is no text."""
    for statement in kind.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant):
            named = any(isinstance(target, ast.Name) and target.id == "title" for target in statement.targets)
            if named and isinstance(statement.value.value, str):
                return statement.value.value
    return ""
