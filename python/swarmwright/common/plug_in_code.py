"""Plug-ins' code: what it raises is reported with class, file and line, and what it returns is checked."""

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
"""Modules and packages whose base classes plug-ins derive from."""


def is_plug_in(kind: type) -> bool:
    """Whether a class is not one of Swarmwright's."""
    return kind.__module__.partition(".")[0] != _PACKAGE


def _is_component(kind: type) -> bool:
    """Whether a class is that of a plug-in."""
    if not is_plug_in(kind):
        return False
    return any(f"{base.__module__}.".startswith(f"{sort}.") for base in kind.__mro__ for sort in _SORTS)


def find_failure(error: BaseException) -> PlugInError | None:
    """Return what is reported of an exception that a plug-in's code raised; None for any other exception.

    It names the class and its method, the exception, and the last line of the plug-in's code.
    """
    found: tuple[type, FrameType] | None = None
    lines: list[tuple[str, int]] = []
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = frame.f_code.co_filename
        kind = _owner(frame)
        if kind is not None and not frame.f_globals.get("__name__", "").startswith(f"{_PACKAGE}."):
            found = kind, frame
        if found is not None and (not is_installed(file) or file == found[1].f_code.co_filename):
            lines.append((file, line))
    if found is None:
        return None
    kind, frame = found
    file, number = lines[-1]
    words = escape_line(str(error)).strip()
    return PlugInError(
        f"{kind.__name__}.{frame.f_code.co_name}: {type(error).__name__}{': ' if words else ''}{words} "
        f"({shorten_path(file)}:{number})"
    )


def _owner(frame: FrameType) -> type | None:
    """Return the plug-in's class whose method is executed in a frame."""
    names = frame.f_code.co_varnames[: frame.f_code.co_argcount]
    if not names or names[0] not in frame.f_locals:
        return None
    first = frame.f_locals[names[0]]
    kind = first if isinstance(first, type) else type(first)
    return kind if _is_component(kind) else None


@contextmanager
def report_failures() -> Iterator[None]:
    """Within the block, what a plug-in's code raises becomes PlugInError; also `sys.exit`."""
    try:
        yield
    except SwarmwrightError:
        raise
    except (Exception, SystemExit) as error:
        found = find_failure(error)
        if found is None:
            raise
        raise found from error


def locate_method(owner: object, method: str) -> str:
    """Return how messages name a method of a plug-in: class, method, file and line."""
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
    what: str,
    *,
    finite: bool = True,
    some: bool = True,
    dtype: type[np.float32] | type[np.float64] = np.float32,
) -> NDArray[Any]:
    """Return what a method of a plug-in returned as an array of numbers.

    Args:
        owner: the plug-in.
        method: its method or property.
        value: what it returned.
        shape: that it must have; None for any size.
        what: what the numbers are, with the names of the sizes: "genomes, (candidates, genes)".
        finite: whether NaN and infinite numbers are refused.
        some: whether there must be a number at all.
        dtype: of the array that is returned.

    Raises PlugInError when it is something else.
    """

    def wrong(found: str) -> PlugInError:
        many = "1 or more" if some else "any"
        sizes = ", ".join(many if size is None else str(size) for size in shape)
        return PlugInError(
            f"{locate_method(owner, method)}: returned {found}; expected {what}: an array of "
            f"{np.dtype(dtype)} with "
            f"the shape ({sizes}{',' * (len(shape) == 1)})"
        )

    if value is None:
        raise wrong("nothing (None)")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:  # rows of different length, for instance
        raise wrong(f"a {type(value).__name__} that is not an array: {escape_line(str(error))}") from error
    if array.dtype.kind not in "fiu":
        raise wrong(f"a {type(value).__name__} of {array.dtype} instead of numbers")
    same = len(array.shape) == len(shape) and all(
        wanted in {size, None} for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not same or (some and not array.size):
        raise wrong(f"numbers with the shape {array.shape}")
    with np.errstate(over="ignore"):
        array = array.astype(dtype, copy=False)
    if finite and not np.isfinite(array).all():
        index = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise wrong(f"{array[index]} at {list(index)}, which is not a finite {np.dtype(dtype)}")
    return array


def count(owner: object, method: str, value: Any, what: str) -> int:  # noqa: ANN401 - as above
    """Return a property of a plug-in that is an integer, at least 1. Raises PlugInError for anything else."""
    if isinstance(value, int | float | np.number) and not isinstance(value, bool) and value >= 1:
        with suppress(OverflowError, ValueError):  # infinity, NaN
            if value == int(value):
                return int(value)
    raise PlugInError(
        f"{locate_method(owner, method)}: is {escape_line(repr(value))}, expected {what}: an integer, at "
        "least 1"
    )
