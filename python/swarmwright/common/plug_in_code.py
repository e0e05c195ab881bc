"""Code of plug-ins: reports exceptions with class, file and line, and checks returned values."""

import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import PlugInError, SwarmwrightError
from swarmwright.common.tracebacks import is_installed, shorten_path
from swarmwright.common.untrusted import escape_line

_PACKAGE = "swarmwright"
_SORTS = (
    "swarmwright.controllers._base",
    "swarmwright.experiment.importing",
    "swarmwright.methods",
    "swarmwright.servers.launchers",
)
"""Modules and packages with the base classes of plug-ins."""


def is_plug_in(kind: type) -> bool:
    """Return whether a class is outside of Swarmwright."""
    return kind.__module__.partition(".")[0] != _PACKAGE


def _is_component(kind: type) -> bool:
    """Return whether a class is a component of a plug-in."""
    if not is_plug_in(kind):
        return False
    return any(f"{base.__module__}.".startswith(f"{sort}.") for base in kind.__mro__ for sort in _SORTS)


def find_failure(error: BaseException) -> PlugInError | None:
    """Return the error to report for an exception raised by a plug-in; None for other exceptions.

    It names the class and method, the exception, and the last line of the plug-in's code.
    """
    method: tuple[type, FrameType] | None = None
    lines: list[tuple[str, int]] = []
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = frame.f_code.co_filename
        kind = _owner(frame)
        if kind is not None and not frame.f_globals.get("__name__", "").startswith(f"{_PACKAGE}."):
            method = kind, frame
        if method is not None and (not is_installed(file) or file == method[1].f_code.co_filename):
            lines.append((file, line))
    if method is None:
        return None
    kind, frame = method
    file, number = lines[-1]
    words = escape_line(str(error)).strip()
    return PlugInError(
        f"{kind.__name__}.{frame.f_code.co_name}: {type(error).__name__}{': ' if words else ''}{words} "
        f"({shorten_path(file)}:{number})"
    )


def _owner(frame: FrameType) -> type | None:
    """Return the class of the plug-in whose method runs in a frame, or None."""
    names = frame.f_code.co_varnames[: frame.f_code.co_argcount]
    if not names or names[0] not in frame.f_locals:
        return None
    first = frame.f_locals[names[0]]
    kind = first if isinstance(first, type) else type(first)
    return kind if _is_component(kind) else None


@contextmanager
def report_failures() -> Iterator[None]:
    """Convert exceptions of a plug-in within the block, including `sys.exit`, to PlugInError."""
    try:
        yield
    except SwarmwrightError:
        raise
    except (Exception, SystemExit) as error:
        failure = find_failure(error)
        if failure is None:
            raise
        raise failure from error


def locate_method(owner: object, method: str) -> str:
    """Describe a method of a plug-in for messages: class, method, file and line."""
    kind = type(owner)
    code = getattr(getattr(kind, method, None), "__code__", None)
    if code is None:  # a property
        code = getattr(getattr(getattr(kind, method, None), "fget", None), "__code__", None)
    where = f" ({shorten_path(code.co_filename)}:{code.co_firstlineno})" if code is not None else ""
    return f"{kind.__name__}.{method}{where}"


def numbers(
    owner: object,
    method: str,
    value: Any,  # noqa: ANN401 - whatever the code returns
    shape: Sequence[int | None],
    noun: str,
    *,
    finite: bool = True,
    some: bool = True,
    dtype: type[np.float32] | type[np.float64] = np.float32,
) -> NDArray[Any]:
    """Check the return value of a plug-in's method, and return it as an array of numbers.

    Args:
        owner: the plug-in.
        method: its method or property.
        value: the returned value.
        shape: required shape; None for any size.
        noun: meaning of the numbers with the names of the sizes: "genomes, (candidates, genes)".
        finite: whether to refuse NaN and infinite numbers.
        some: whether to refuse an empty array.
        dtype: dtype of the returned array.

    Raises PlugInError for other values.
    """

    def wrong(description: str) -> PlugInError:
        many = "1 or more" if some else "any"
        sizes = ", ".join(many if size is None else str(size) for size in shape)
        return PlugInError(
            f"{locate_method(owner, method)}: returned {description}; expected {noun}: an array of "
            f"{np.dtype(dtype)} with "
            f"the shape ({sizes}{',' * (len(shape) == 1)})"
        )

    if value is None:
        raise wrong("nothing (None)")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:  # for instance, rows of different length
        raise wrong(f"a {type(value).__name__} that is not an array: {escape_line(str(error))}") from error
    if array.dtype.kind not in "fiu":
        raise wrong(f"a {type(value).__name__} of {array.dtype} instead of numbers")
    has_shape = len(array.shape) == len(shape) and all(
        expected in {size, None} for size, expected in zip(array.shape, shape, strict=True)
    )
    if not has_shape or (some and not array.size):
        raise wrong(f"numbers with the shape {array.shape}")
    with np.errstate(over="ignore"):
        array = array.astype(dtype, copy=False)
    if finite and not np.isfinite(array).all():
        index = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise wrong(f"{array[index]} at {list(index)}, which is not a finite {np.dtype(dtype)}")
    return array


def count(owner: object, method: str, value: Any, noun: str) -> int:  # noqa: ANN401 - as above
    """Check a property of a plug-in that is an integer, at least 1. Raises PlugInError for other values."""
    if isinstance(value, int | float | np.number) and not isinstance(value, bool) and value >= 1:
        with suppress(OverflowError, ValueError):  # infinity, NaN
            if value == int(value):
                return int(value)
    raise PlugInError(
        f"{locate_method(owner, method)}: is {escape_line(repr(value))}, expected {noun}: an integer, at "
        "least 1"
    )
