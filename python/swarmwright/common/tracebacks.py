"""Files and lines in tracebacks."""

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
    """Return a path, relative if it is below the working folder."""
    path = Path(file)
    with contextlib.suppress(OSError):
        folder = Path.cwd()
        return str(path.relative_to(folder) if path.is_relative_to(folder) else path)
    return file


def is_installed(file: str) -> bool:
    """Return whether a file belongs to Swarmwright, to Python, or to an installed package."""
    path = Path(file)
    if {"site-packages", "dist-packages"} & set(path.parts):
        return True
    # Compiled packages, such as NumPy's random numbers, have paths of the build machine.
    if path.suffix in _CYTHON and not path.is_file():
        return True
    return file.startswith("<") or any(path.is_relative_to(folder) for folder in _installation_folders())


@cache
def _installation_folders() -> tuple[Path, ...]:
    """Return the folders of Swarmwright and of Python."""
    python = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib")}
    return (Path(__file__).parents[1], *(Path(folder) for folder in sorted(python) if folder))


def exception_text(error: BaseException) -> str:
    """Return the text of an exception, whose own code may fail."""
    try:
        return str(error)
    except Exception as failure:  # noqa: BLE001 - a user's code may fail in any way
        return f"its text is unavailable: {type(failure).__name__}"


def locate_error(error: BaseException) -> str:
    """Return kind, text and last line of user code of an exception: `KeyError: 'x' (mine.py:12)`.

    An exception without a text is shown with its code: `AssertionError (mine.py:12: assert left > 0)`.
    """
    words = escape_line(exception_text(error)).strip()
    description = f"{type(error).__name__}{': ' if words else ''}{words}"
    frames = traceback.walk_tb(error.__traceback__)
    lines = [(frame.f_code.co_filename, line) for frame, line in frames]
    user_lines = [(file, line) for file, line in lines if not is_installed(file)]
    if not user_lines:
        return description
    file, line = user_lines[-1]
    code = "" if words else escape_line(linecache.getline(file, line).strip())
    return f"{description} ({shorten_path(file)}:{line}{': ' if code else ''}{code})"


def locate_definition(kind: Any) -> str:  # noqa: ANN401 - a class or a function
    """Return the file and line of the definition of a class or function."""
    try:
        return f"{shorten_path(inspect.getsourcefile(kind) or '')}:{inspect.getsourcelines(kind)[1]}"
    except (OSError, TypeError):
        return f"{kind.__module__}.{kind.__qualname__}"
