"""Suggestions for unknown names of simulations."""

import ast
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from swarmwright.common.simulation_names import LIBRARIES, SIMULATORS, simulator_file
from swarmwright.common.suggestions import did_you_mean, nearest
from swarmwright.simulations import catalogue
from swarmwright.simulations.loading import classes_of_file


def describe_missing_class(name: str, folder: Path | None = None) -> str:
    """Return a message that the name lacks a class, with the classes in the file.

    Args:
        name: path of the file, as the user wrote it.
        folder: folder that it is relative to; default: the working folder.

    Raises InputError if the file does not exist or cannot be imported.
    """
    classes = classes_of_file((folder or Path()) / name)
    content = (
        f"{name} has {', '.join(classes)}" if classes else f"{name} has no subclass of swarmwright.Simulation"
    )
    write = f": write {name}:{classes[0]}" if classes else ""
    return f"the name of a simulation in Python consists of its file and its class; {content}{write}"


_MOST_FILES = 200
"""Largest number of files of a folder that are searched for classes."""
_LARGEST_FILE = 1 << 20
"""Bytes of a file that is searched for classes, at most."""


def describe_unknown_simulation(name: str, folder: Path | None = None) -> str:
    """Return a message about an unknown title, with a suggestion and all titles.

    folder: folder whose files are searched for classes, without importing them; default: the working folder.
    """
    note = simulator_file(name)
    if note is not None:
        return f"{name!r} {note}"
    full_name = _find_full_name(name, folder or Path())
    if full_name is None and name in SIMULATORS:
        return f"{name!r} is not built in: servers of another simulator offer it, see {SIMULATORS[name]}"
    hint = suggest_title(name) or ";" if full_name is None else f"; did you mean {full_name!r}?"
    return f"unknown simulation {name!r}{hint} available: {', '.join(catalogue.titles())}"


def suggest_title(simulation: str) -> str:
    """Return "; did you mean 'x'?" for a misspelt title of a built-in simulation or another simulator.

    Empty for a known title, and if no title is similar.
    """
    titles = (*catalogue.titles(), *SIMULATORS)
    return "" if catalogue.is_local(simulation) or simulation in titles else did_you_mean(simulation, titles)


def describe_other_file(path: Path) -> str | None:
    """Return a message about a file that is not an experiment; None if its name does not tell."""
    note = simulator_file(path.name)
    if note is not None:
        return f"{path}: {note}"
    if path.suffix != ".py":
        return None
    class_name = next((f"{path.name}:{name}" for name, _ in _classes(path)), f"{path.name}:CLASS")
    return (
        f"{path}: a Python program is not an experiment; write an experiment file with the line "
        f"'simulation: {class_name}'"
    )


def _find_full_name(name: str, folder: Path) -> str | None:
    """Return the full name of a class or environment if `name` is a part of it, else None."""
    library, _, environment = name.partition(":")
    suggestion = nearest(library, LIBRARIES)
    if environment and suggestion is not None:
        return f"{suggestion}:{environment}"
    for path in sorted(folder.glob("*.py"))[:_MOST_FILES]:
        for kind, title in _classes(path):
            if name in {kind, title}:
                return f"{path.name}:{kind}"
    return f"gymnasium:{name}" if _is_registered_in_gymnasium(name) else None


def _is_registered_in_gymnasium(name: str) -> bool:
    """Return whether Gymnasium has an environment of this name."""
    if find_spec("gymnasium") is None:
        return False
    with suppress(Exception):  # ignore a damaged installation
        from gymnasium import registry  # noqa: PLC0415 - only for this message

        return name in registry
    return False


def _classes(path: Path) -> Iterator[tuple[str, str]]:
    """Yield name and `title` of the classes with bases in a file; nothing if it cannot be read."""
    with suppress(OSError, SyntaxError, ValueError):
        if path.stat().st_size > _LARGEST_FILE:
            return
        for statement in ast.parse(path.read_bytes()).body:
            if isinstance(statement, ast.ClassDef) and statement.bases:
                yield statement.name, _title(statement)


def _title(kind: ast.ClassDef) -> str:
    """Return the string that a class assigns to `title`; empty if there is none."""
    for statement in kind.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant):
            named = any(isinstance(target, ast.Name) and target.id == "title" for target in statement.targets)
            if named and isinstance(statement.value.value, str):
                return statement.value.value
    return ""
