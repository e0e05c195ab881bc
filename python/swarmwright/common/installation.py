"""Checks of the installation."""

import sys
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

_ADVICE = (
    "`make demo` builds it in a clone of the repository, and wheels contain it for the processor and system "
    "in their names"
)


class UnloadableError(ImportError):
    """The engine is for another processor or system, or lacks a library."""

    exit_status = 1


def problem() -> str | None:
    """Return a message if Swarmwright cannot run here, with the remedy; None if it can.

    The engine is not loaded; `engine` checks that.
    """
    if not _is_linux():
        return f"Swarmwright runs on Linux, not on {sys.platform}: use WSL 2 on Windows, a container on macOS"
    if find_spec("swarmwright._engine") is None:
        return f"Swarmwright's engine is not installed: {_ADVICE}"
    return None


def check_system() -> None:
    """Raise ImportError on systems other than Linux, which lack modules that Swarmwright imports."""
    if not _is_linux():
        raise ImportError(problem())


def engine() -> ModuleType:
    """Return the engine. Raises ImportError if it cannot be loaded."""
    reason = problem()
    if reason is not None:
        raise ImportError(reason)
    try:
        return import_module("swarmwright._engine")
    except ImportError as error:
        raise UnloadableError(f"Swarmwright's engine cannot be loaded here: {error}; {_ADVICE}") from error


def _is_linux() -> bool:
    return sys.platform.startswith("linux")
