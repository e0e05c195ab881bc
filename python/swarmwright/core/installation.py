"""Whether what is installed can run here."""

import sys
from importlib.util import find_spec


def problem() -> str | None:
    """Return what keeps Swarmwright from running here and what to do, None if nothing does."""
    if not sys.platform.startswith("linux"):
        return f"Swarmwright runs on Linux, not on {sys.platform}: use WSL 2 on Windows, a container on macOS"
    if find_spec("swarmwright._engine") is None:
        return (
            "Swarmwright's engine is not installed: `make demo` builds it in a clone of the repository, and "
            "wheels have it for the processor and the system of their names"
        )
    return None
