"""Valid names of metrics, which are variables in expressions for fitness."""

import re
from collections.abc import Iterable

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_OTHER = re.compile(r"[^A-Za-z0-9_]")


def problem_of(name: object) -> str | None:
    """Return the problem of a metric's name; None if it is valid.

    Python keywords are accepted, because stored runs may have them; expressions cannot use them.
    """
    if isinstance(name, str) and _NAME.fullmatch(name):
        return None
    rule = "a metric's name has letters (A-Z, a-z), digits and _, and does not begin with a digit"
    return f"{name!r}: {_wrong_in(name)}; {rule}"


def check(names: Iterable[object]) -> None:
    """Raise ValueError with the problem of the first invalid name."""
    for name in names:
        problem = problem_of(name)
        if problem:
            raise ValueError(problem)


def _wrong_in(name: object) -> str:
    if not isinstance(name, str):
        return f"is of the type {type(name).__name__}, not text"
    if not name:
        return "is empty"
    others = dict.fromkeys(_OTHER.findall(name))
    return f"has {', '.join(map(repr, others))}" if others else "begins with a digit"


def suggest_name(name: str) -> str:
    """Return the most similar valid name."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"_{word}" if not word or word[0].isdigit() else word
