"""Checks of arguments of public functions, with messages that state the expected value."""

import functools
import inspect
import math
import numbers
import operator
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.untrusted import escape_line

_LARGEST_SEED = 2**63 - 1
"""Largest seed of an experiment."""
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def check_arguments(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Check the arguments of a public function by their names, which have one meaning in all functions.

    Defaults and names that are not in `_CHECKS` are not checked. Numbers of other libraries become Python's.
    """
    parameters = inspect.signature(function).parameters
    defaults = {name: parameter.default for name, parameter in parameters.items() if name in _CHECKS}
    places = [
        (position, name)
        for position, (name, parameter) in enumerate(parameters.items())
        if name in _CHECKS and parameter.kind is not parameter.KEYWORD_ONLY
    ]

    def check(name: str, value: object) -> object:
        return value if value is defaults[name] else _CHECKS[name](name, value)

    @functools.wraps(function)
    def call(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        first: Any = list(args)
        for position, name in places:
            if position < len(first):
                first[position] = check(name, first[position])
        named: Any = {
            name: check(name, value) if name in defaults else value for name, value in kwargs.items()
        }
        return function(*first, **named)

    return call


def path_of(name: str, value: object, noun: str) -> Path:
    """Return an argument as a path. Raises InputError for other types.

    noun: what the path names, such as "a run folder".
    """
    if isinstance(value, str | os.PathLike):
        path = os.fspath(value)
        if isinstance(path, str) and "\0" in path:
            raise InputError(f"{name}: a path cannot hold the character NUL, as {format_value(path)} does")
        if isinstance(path, str):
            return Path(path)
    raise InputError(f"{name}: must be the path of {noun}, not {describe_value(value)}")


def text(name: str, value: object, noun: str) -> str:
    """Return a text argument. Raises InputError for other types; noun: its meaning, such as "a name"."""
    if isinstance(value, str):
        return str(value)
    raise InputError(f"{name}: must be {noun}, not {describe_value(value)}")


def integer(name: str, value: object) -> int:
    """Return an integer argument, also of NumPy. Raises InputError for other types."""
    candidate: Any = value
    if not isinstance(value, bool):
        try:
            return operator.index(candidate)
        except TypeError:
            pass
    raise InputError(f"{name}: must be an integer, not {describe_value(value)}")


def simulation_seed(name: str, value: object) -> int:
    """Return an argument that is a simulation seed. Raises InputError for other values."""
    seed = integer(name, value)
    if not 0 <= seed <= _LARGEST_SEED:
        raise InputError(f"{name}: must be from 0 to 2**63 - 1, not {seed}")
    return seed


def number(name: str, value: object) -> float:
    """Return an argument that is a finite number. Raises InputError for other values."""
    candidate: Any = value
    if _is_finite(value):
        return candidate if type(candidate) in {int, float} else float(candidate)
    raise InputError(f"{name}: must be a finite number, not {describe_value(value)}")


def flag(name: str, value: object) -> bool:
    """Return a Boolean argument, also of NumPy. Raises InputError for other types."""
    if isinstance(value, bool) or type(value).__name__ in {"bool", "bool_"}:
        return bool(value)
    raise InputError(f"{name}: must be True or False, not {describe_value(value)}")


def function(name: str, value: object, arguments: Sequence[str]) -> Callable[..., Any]:
    """Return an argument that is a function.

    Raises InputError if it cannot be called with `arguments`, or is asynchronous.
    """
    expected = f"{name}: must be a function that takes ({', '.join(arguments)})"
    if not callable(value):
        raise InputError(f"{expected}, not {describe_value(value)}")
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # written in C
        return value
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise InputError(f"{expected}; {_function_name(value)} takes {signature}: {error}") from None
    if inspect.iscoroutinefunction(value) or inspect.iscoroutinefunction(type(value).__call__):
        raise InputError(
            f"{expected}; {_function_name(value)} is asynchronous (async def), and would not be awaited"
        )
    return value


def _function_name(value: object) -> str:
    """Return the name of a function."""
    name: str = getattr(value, "__qualname__", type(value).__qualname__)
    return name


def mapping(name: str, value: object, instead: str) -> Mapping[Any, Any]:
    """Return an argument that is a mapping. Raises InputError for other types; instead: what to write."""
    if isinstance(value, Mapping):
        return value
    raise InputError(f"{name}: must be a mapping, not {describe_value(value)}; write {instead}")


def require_list(name: str, value: object, noun: str) -> None:
    """Raise InputError unless an argument is a list or another iterable, except texts and mappings.

    A text would be read as its characters. noun: the items, such as "run folders".
    """
    if isinstance(value, str | os.PathLike):
        raise InputError(
            f"{name}: must be a list of {noun}, not {describe_value(value)}; write [{str(value)!r}]"
        )
    if isinstance(value, bytes | Mapping) or not isinstance(value, Iterable):
        raise InputError(f"{name}: must be a list of {noun}, not {describe_value(value)}")


def instance(name: str, value: object, kind: type, instead: str) -> None:
    """Raise InputError unless an argument is an instance; instead: what to write, as "Run.open(folder)"."""
    if not isinstance(value, kind):
        raise InputError(
            f"{name}: must be of the class {kind.__name__}, not {describe_value(value)}; write {instead}"
        )


def describe_value(value: object) -> str:
    """Describe an object in a line: simple values as they are written, others by their class."""
    with suppress(Exception):  # a representation may fail, such as that of an integer of 5,000 digits
        if value is None or isinstance(value, str | int | float | list | dict):
            return escape_line(format_value(value))
    return f"an object of the class {type(value).__name__}"


def _is_finite(value: object) -> bool:
    """Return whether a value is a real number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond binary64
        return False


def _servers(name: str, value: object) -> object:
    if isinstance(value, str | Mapping | Sequence) and not isinstance(value, bytes):
        return value
    try:
        return integer(name, value)
    except InputError:
        raise InputError(
            f"{name}: must be auto, local, in-process or a number from 1 on, not {describe_value(value)}"
        ) from None


def _wait(name: str, value: object) -> float:
    candidate: Any = value
    if _is_finite(value) and candidate >= 0:
        return float(candidate)
    raise InputError(f"{name}: is {describe_value(value)}, expected seconds: a finite number, at least 0")


def _axis(name: str, value: object) -> object:
    if isinstance(value, str) and value in {"evaluations", "generations"}:
        return value
    raise InputError(f"{name}: must be one of evaluations, generations, not {describe_value(value)}")


def _simulation(name: str, value: object) -> object:
    if isinstance(value, str | type):
        return value
    raise InputError(f"{name}: must be a class, or 'FILE:Class', not {describe_value(value)}")


def _check_each(check: Callable[..., object], names: str, *more: object) -> dict[str, Callable[..., object]]:
    return {name: lambda name, value: check(name, value, *more) for name in names.split()}


_CHECKS: Mapping[str, Callable[..., object]] = {
    **_check_each(
        integer, "seed episodes generations evaluations candidates points random jobs at at_episodes"
    ),
    **_check_each(integer, "candidate generation episode sensors actuators"),
    **_check_each(number, "seconds speed"),
    **_check_each(flag, "progress visual trust accept_changed_code pseudo_reality verify force held_out"),
    **_check_each(function, "on_generation", ("generation",)),
    **_check_each(function, "on_progress", ("done", "total", "waiting_for")),
    **_check_each(path_of, "out", "a folder for the results"),
    **_check_each(path_of, "output", "a folder"),
    **_check_each(path_of, "path file mapping license field", "a file"),
    **_check_each(text, "broker", "the URL of a broker such as mqtt://localhost:1883"),
    **_check_each(text, "prefix group", "a text"),
    **_check_each(text, "uri", "the URI of a tracking server such as http://localhost:5000"),
    **_check_each(text, "name mission", "a name"),
    "servers": _servers,
    "wait": _wait,
    "x": _axis,
    "simulation": _simulation,
}
"""Name of an argument -> function that checks it, given name and value, and returns the value."""
