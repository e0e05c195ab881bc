"""Arguments of public functions: obvious mistakes are refused with a message that says what is expected."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.problems import shown


def path_of(name: str, given: object, what: str) -> Path:
    """Return an argument as a path. Raises InputError for what is not one.

    what: that it names, as "a run folder".
    """
    if isinstance(given, str | os.PathLike) and isinstance(os.fspath(given), str):
        return Path(given)
    raise InputError(f"{name}: must be the path of {what}, not {_shown(given)}")


def listed(name: str, given: object, what: str) -> None:
    """Raise InputError unless an argument is a list, or another iterable but a text or a mapping.

    A text would be taken for its characters. what: its items, as "run folders".
    """
    if isinstance(given, str | os.PathLike):
        raise InputError(f"{name}: must be a list of {what}, not {_shown(given)}; write [{str(given)!r}]")
    if isinstance(given, bytes | Mapping) or not isinstance(given, Iterable):
        raise InputError(f"{name}: must be a list of {what}, not {_shown(given)}")


def instance(name: str, given: object, kind: type, instead: str) -> None:
    """Raise InputError unless an argument is of a class; instead: what to write, as "Run.open(folder)"."""
    if not isinstance(given, kind):
        raise InputError(
            f"{name}: must be of the class {kind.__name__}, not {_shown(given)}; write {instead}"
        )


def _shown(given: object) -> str:
    if given is None or isinstance(given, str | int | float | list | dict):
        return shown(given)
    return f"an object of the class {type(given).__name__}"
