"""Whether what is installed can run here."""

import sys
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

_ADVICE = (
    "`make demo` builds it in a clone of the repository, and wheels have it for the processor and the system "
    "of their names"
)


class UnloadableError(ImportError):
    """The engine is for another processor or system, or lacks a library: no fault of the program."""

    exit_status = 1


def problem() -> str | None:
    """Return what keeps Swarmwright from running here and what to do, None if nothing does.

    The engine is not loaded: whether that succeeds, `engine` says.
    """
    if not _is_linux():
        return f"Swarmwright runs on Linux, not on {sys.platform}: use WSL 2 on Windows, a container on macOS"
    if find_spec("swarmwright._engine") is None:
        return f"Swarmwright's engine is not installed: {_ADVICE}"
    return None


def check_system() -> None:
    """Raise ImportError on another system, where modules of Python that Swarmwright imports are missing."""
    if not _is_linux():
        raise ImportError(problem())


def engine() -> ModuleType:
    """Return the engine. Raises ImportError where it cannot be loaded here."""
    found = problem()
    if found is not None:
        raise ImportError(found)
    try:
        return import_module("swarmwright._engine")
    except ImportError as error:
        raise UnloadableError(f"Swarmwright's engine cannot be loaded here: {error}; {_ADVICE}") from error


def _is_linux() -> bool:
    return sys.platform.startswith("linux")
