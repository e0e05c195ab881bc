"""Arguments of public functions: obvious mistakes are refused with a message that says what is expected."""

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
"""Of an experiment."""
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def check_arguments(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Check the arguments of a public function by their names, which mean the same in all of them.

    Those that are not in `_CHECKS` are left to the function, and so are defaults. Numbers of other libraries
    become Python's.
    """
    parameters = inspect.signature(function).parameters
    defaults = {name: parameter.default for name, parameter in parameters.items() if name in _CHECKS}
    places = [
        (place, name)
        for place, (name, parameter) in enumerate(parameters.items())
        if name in _CHECKS and parameter.kind is not parameter.KEYWORD_ONLY
    ]

    def accepted(name: str, given: object) -> object:
        return given if given is defaults[name] else _CHECKS[name](name, given)

    @functools.wraps(function)
    def call(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        first: Any = list(args)
        for place, name in places:
            if place < len(first):
                first[place] = accepted(name, first[place])
        named: Any = {
            name: accepted(name, given) if name in defaults else given for name, given in kwargs.items()
        }
        return function(*first, **named)

    return call


def path_of(name: str, given: object, what: str) -> Path:
    """Return an argument as a path. Raises InputError for what is not one.

    what: that it names, as "a run folder".
    """
    if isinstance(given, str | os.PathLike):
        path = os.fspath(given)
        if isinstance(path, str) and "\0" in path:
            raise InputError(f"{name}: a path cannot hold the character NUL, as {format_value(path)} does")
        if isinstance(path, str):
            return Path(path)
    raise InputError(f"{name}: must be the path of {what}, not {describe_value(given)}")


def text(name: str, given: object, what: str) -> str:
    """Return an argument that is a text. Raises InputError for others; what: it is, as "a name"."""
    if isinstance(given, str):
        return str(given)
    raise InputError(f"{name}: must be {what}, not {describe_value(given)}")


def integer(name: str, given: object) -> int:
    """Return an argument that is an integer, also NumPy's. Raises InputError for others."""
    found: Any = given
    if not isinstance(given, bool):
        try:
            return operator.index(found)
        except TypeError:
            pass
    raise InputError(f"{name}: must be an integer, not {describe_value(given)}")


def simulation_seed(name: str, given: object) -> int:
    """Return an argument that is the seed of a simulation. Raises InputError for others."""
    seed = integer(name, given)
    if not 0 <= seed <= _LARGEST_SEED:
        raise InputError(f"{name}: must be from 0 to 2**63 - 1, not {seed}")
    return seed


def number(name: str, given: object) -> float:
    """Return an argument that is a finite number. Raises InputError for others."""
    found: Any = given
    if _is_finite(given):
        return found if type(found) in {int, float} else float(found)
    raise InputError(f"{name}: must be a finite number, not {describe_value(given)}")


def flag(name: str, given: object) -> bool:
    """Return an argument that is True or False, also NumPy's. Raises InputError for others."""
    if isinstance(given, bool) or type(given).__name__ in {"bool", "bool_"}:
        return bool(given)
    raise InputError(f"{name}: must be True or False, not {describe_value(given)}")


def function(name: str, given: object, arguments: Sequence[str]) -> Callable[..., Any]:
    """Return an argument that is a function.

    Raises InputError for what cannot be called with `arguments`, and for asynchronous functions.
    """
    expected = f"{name}: must be a function that takes ({', '.join(arguments)})"
    if not callable(given):
        raise InputError(f"{expected}, not {describe_value(given)}")
    try:
        signature = inspect.signature(given)
    except (TypeError, ValueError):  # one that is written in C
        return given
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise InputError(f"{expected}; {_function_name(given)} takes {signature}: {error}") from None
    if inspect.iscoroutinefunction(given) or inspect.iscoroutinefunction(type(given).__call__):
        raise InputError(
            f"{expected}; {_function_name(given)} is asynchronous (async def), and would not be awaited"
        )
    return given


def _function_name(given: object) -> str:
    """Return what a function is called."""
    name: str = getattr(given, "__qualname__", type(given).__qualname__)
    return name


def mapping(name: str, given: object, instead: str) -> Mapping[Any, Any]:
    """Return an argument that is a mapping. Raises InputError for others; instead: what to write."""
    if isinstance(given, Mapping):
        return given
    raise InputError(f"{name}: must be a mapping, not {describe_value(given)}; write {instead}")


def require_list(name: str, given: object, what: str) -> None:
    """Raise InputError unless an argument is a list, or another iterable but a text or a mapping.

    A text would be taken for its characters. what: its items, as "run folders".
    """
    if isinstance(given, str | os.PathLike):
        raise InputError(
            f"{name}: must be a list of {what}, not {describe_value(given)}; write [{str(given)!r}]"
        )
    if isinstance(given, bytes | Mapping) or not isinstance(given, Iterable):
        raise InputError(f"{name}: must be a list of {what}, not {describe_value(given)}")


def instance(name: str, given: object, kind: type, instead: str) -> None:
    """Raise InputError unless an argument is of a class; instead: what to write, as "Run.open(folder)"."""
    if not isinstance(given, kind):
        raise InputError(
            f"{name}: must be of the class {kind.__name__}, not {describe_value(given)}; write {instead}"
        )


def describe_value(given: object) -> str:
    """Return what an object is, in a line: short values as they are written, others by their class."""
    with suppress(Exception):  # a representation may fail, as that of an integer of 5,000 digits does
        if given is None or isinstance(given, str | int | float | list | dict):
            return escape_line(format_value(given))
    return f"an object of the class {type(given).__name__}"


def _is_finite(given: object) -> bool:
    """Whether it is a real number that a float can hold."""
    if isinstance(given, bool) or not isinstance(given, numbers.Real):
        return False
    try:
        return math.isfinite(given)
    except OverflowError:  # an integer beyond binary64
        return False


def _servers(name: str, given: object) -> object:
    if isinstance(given, str | Mapping | Sequence) and not isinstance(given, bytes):
        return given
    try:
        return integer(name, given)
    except InputError:
        raise InputError(
            f"{name}: must be auto, local, in-process or a number from 1 on, not {describe_value(given)}"
        ) from None


def _wait(name: str, given: object) -> float:
    found: Any = given
    if _is_finite(given) and found >= 0:
        return float(found)
    raise InputError(f"{name}: is {describe_value(given)}, expected seconds: a finite number, at least 0")


def _axis(name: str, given: object) -> object:
    if isinstance(given, str) and given in {"evaluations", "generations"}:
        return given
    raise InputError(f"{name}: must be one of evaluations, generations, not {describe_value(given)}")


def _simulation(name: str, given: object) -> object:
    if isinstance(given, str | type):
        return given
    raise InputError(f"{name}: must be a class, or 'FILE:Class', not {describe_value(given)}")


def _each(check: Callable[..., object], names: str, *more: object) -> dict[str, Callable[..., object]]:
    return {name: lambda name, given: check(name, given, *more) for name in names.split()}


_CHECKS: Mapping[str, Callable[..., object]] = {
    **_each(integer, "seed episodes generations evaluations candidates points random jobs at at_episodes"),
    **_each(integer, "candidate generation episode sensors actuators"),
    **_each(number, "seconds speed"),
    **_each(flag, "progress visual trust accept_changed_code pseudo_reality verify force held_out"),
    **_each(function, "on_generation", ("generation",)),
    **_each(function, "on_progress", ("done", "total", "waiting_for")),
    **_each(path_of, "out", "a folder for the results"),
    **_each(path_of, "output", "a folder"),
    **_each(path_of, "path file mapping license field", "a file"),
    **_each(text, "broker", "the URL of a broker such as mqtt://localhost:1883"),
    **_each(text, "prefix group", "a text"),
    **_each(text, "uri", "the URI of a tracking server such as http://localhost:5000"),
    **_each(text, "name mission", "a name"),
    "servers": _servers,
    "wait": _wait,
    "x": _axis,
    "simulation": _simulation,
}
"""Name of an argument -> what checks it, given name and value, and returns the value."""
