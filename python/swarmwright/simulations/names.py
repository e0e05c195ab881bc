"""Names of custom simulations: `package.module:Class`, `path/to/file.py:Class`, or `library:environment`."""

import re
import sys
from pathlib import Path
from types import ModuleType

from swarmwright.core.environment_names import is_adapted
from swarmwright.core.errors import InputError
from swarmwright.user_code.copying import FOLDER as CODE
from swarmwright.user_code.copying import beside

_PYTHON_NAME = re.compile(r"(?:.*\.py|[^\W\d]\w*(?:\.[^\W\d]\w*)*):[^\W\d]\w*")
FROM_FILE = "swarmwright simulation "
"""Begins the name of modules that are named by their file."""
files: dict[str, ModuleType] = {}
"""Path of a file -> its module."""


def is_python(simulation: str) -> bool:
    """Whether a simulation is named by its class, or as another library's environment, not by a title."""
    return _PYTHON_NAME.fullmatch(simulation) is not None or is_adapted(simulation)


def absolute(name: str, folder: Path | None = None) -> str:
    """Return a name that means the same in every folder, as far as it is that of a file."""
    if is_adapted(name):
        return name
    place, colon, wanted = name.rpartition(":")
    return f"{((folder or Path()) / place).resolve()}{colon}{wanted}" if place.endswith(".py") else name


def of_run(name: str, run: Path) -> str:
    """Return the absolute name of a run's simulation.

    Without a copy in the run folder, because an earlier version wrote it or the copy was deleted, a file in
    or beside the folder takes precedence over the original place: a folder may be copied together with its
    file.
    """
    place, colon, wanted = name.rpartition(":")
    name = absolute(name, run)
    if place.endswith(".py") and not (run / CODE in (run / place).parents and (run / place).exists()):
        for path in beside(run.resolve(), Path(place)):
            if path.is_file():
                return f"{path}{colon}{wanted}"
    return name


def name_of(kind: type) -> str:
    """Return the name by which other processes find a class.

    Classes of a script are found in its file; those of a notebook, as __main__:Class, in this process alone.
    Raises InputError for a class that is defined within a function or another class.
    """
    adapted: str = vars(kind).get("adapted", "")
    if adapted:
        return adapted
    if kind.__qualname__ != kind.__name__:
        raise InputError(
            f"simulation: {kind.__qualname__} is not defined at the top level of a module, "
            "so it cannot be found by its name"
        )
    module = sys.modules.get(kind.__module__)
    file = getattr(module, "__file__", None)
    if module is not None and file is not None and kind.__module__.startswith(("__main__", FROM_FILE)):
        path = str(Path(file).resolve())
        files.setdefault(path, module)
        return f"{path}:{kind.__name__}"
    return f"{kind.__module__}:{kind.__name__}"
