"""Files in tracebacks: how they are shown, and what they belong to."""

import contextlib
import inspect
import linecache
import sysconfig
import traceback
from functools import cache
from pathlib import Path
from typing import Any

from swarmwright.common.untrusted import escape_line

_CYTHON = frozenset({".pyx", ".pxd", ".pxi"})
"""Suffixes of source files of Cython."""


def shorten_path(file: str) -> str:
    """A file's path, relative where it lies below the working folder."""
    path = Path(file)
    with contextlib.suppress(OSError):
        folder = Path.cwd()
        return str(path.relative_to(folder) if path.is_relative_to(folder) else path)
    return file


def is_installed(file: str) -> bool:
    """Whether a file belongs to Swarmwright, to Python, or to a package that was installed."""
    path = Path(file)
    if {"site-packages", "dist-packages"} & set(path.parts):
        return True
    # Compiled packages, such as NumPy's random numbers, have paths of the machine that compiled them.
    if path.suffix in _CYTHON and not path.is_file():
        return True
    return file.startswith("<") or any(path.is_relative_to(place) for place in _places())


@cache
def _places() -> tuple[Path, ...]:
    """Folders of Swarmwright and of Python."""
    python = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib")}
    return (Path(__file__).parents[1], *(Path(place) for place in sorted(python) if place))


def exception_text(error: BaseException) -> str:
    """Return what an exception says; its own code may fail, too."""
    try:
        return str(error)
    except Exception as other:  # noqa: BLE001 - a user's code may fail in any way
        return f"its text cannot be made: {type(other).__name__}"


def locate_error(error: BaseException) -> str:
    """Return kind, text, and the last line of code that is not installed: `KeyError: 'x' (mine.py:12)`.

    An exception without a text is shown with the code: `AssertionError (mine.py:12: assert left > 0)`.
    """
    words = escape_line(exception_text(error)).strip()
    found = f"{type(error).__name__}{': ' if words else ''}{words}"
    frames = traceback.walk_tb(error.__traceback__)
    lines = [(frame.f_code.co_filename, line) for frame, line in frames]
    own = [(file, line) for file, line in lines if not is_installed(file)]
    if not own:
        return found
    file, line = own[-1]
    code = "" if words else escape_line(linecache.getline(file, line).strip())
    return f"{found} ({shorten_path(file)}:{line}{': ' if code else ''}{code})"


def locate_definition(kind: Any) -> str:  # noqa: ANN401 - a class or a function
    """Return the file and the line in which a class or a function is defined."""
    try:
        return f"{shorten_path(inspect.getsourcefile(kind) or '')}:{inspect.getsourcelines(kind)[1]}"
    except (OSError, TypeError):
        return f"{kind.__module__}.{kind.__qualname__}"
