"""Names of user-defined simulations: where a name leads to, and which name a class has."""

import os
import sys
from pathlib import Path
from types import ModuleType
from urllib.parse import quote, unquote, unquote_to_bytes

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.user_code.copying import FOLDER as CODE
from swarmwright.simulations.user_code.copying import Copy, Kept, beside

FROM_FILE = "swarmwright_files."
"""Begins the name of modules that are named by their file, see that package."""
_SCRIPTS = ("__main__", "__mp_main__")
"""What the module of a script is called, in its process and in those that multiprocessing starts."""
files: dict[str, ModuleType] = {}
"""Path of a file -> its module."""


def module_name(file: Path) -> str:
    """Return the name under which the module of a file can be imported, in any process."""
    return f"{FROM_FILE}{_quoted(os.fsencode(file))}"


def module_name_beside(folder: Path, module: str) -> str:
    """Return the same for a module of a folder whose modules are isolated from others of their names."""
    return f"{module_name(folder)}:{_quoted(module.encode())}"


def place_of_module(name: str) -> tuple[Path, str]:
    """Return the file of a name that `module_name` made, and ""; else the folder, and the module in it."""
    path, _, module = name.removeprefix(FROM_FILE).partition(":")
    return Path(os.fsdecode(unquote_to_bytes(path))), unquote(module)


def _quoted(text: bytes) -> str:
    """Return text that is one part of the name of a module: without dots; colons separate, see above."""
    return quote(text, safe="/").replace(".", "%2E")


def absolute(name: str, folder: Path | None = None) -> str:
    """Return a name that means the same in every folder, as far as it is that of a file."""
    parsed = SimulationName.parse(name)
    return name if parsed.file is None else parsed.in_file(((folder or Path()) / parsed.file).resolve())


def relative_name(name: str, folder: Path) -> str:
    """Return a name as an experiment file in this folder writes it."""
    parsed = SimulationName.parse(name)
    if parsed.file is None:
        return name
    try:
        return parsed.in_file(Path(os.path.relpath(parsed.file, folder)))
    except ValueError:  # on another drive
        return name


def of_run(name: str, run: Path) -> str:
    """Return the absolute name of a run's simulation.

    Where the copy in the run folder was deleted, a file in or beside the folder takes precedence over the
    original place: a folder may be copied together with its file.
    """
    parsed = SimulationName.parse(name)
    file = parsed.file
    if file is not None and not (run / CODE in (run / file).parents and (run / file).exists()):
        for path in beside(run.resolve(), file):
            if path.is_file():
                return parsed.in_file(path)
    return absolute(name, run)


def environment_in(copy: Copy, kept: Kept) -> str:
    """Return the name of an environment whose module is a run's copy: with its file in place of the module.

    `gymnasium:/runs/a/code/1/simulation/maze.py:Maze-v0`
    """
    parsed = SimulationName.parse(kept.component)
    environment = f":{parsed.place.rpartition(':')[2]}" if parsed.library == "gymnasium" else ""
    options = f"?{parsed.query}" if parsed.query else ""
    return f"{parsed.library}:{quote(str(copy.place(kept).absolute()))}{environment}{options}"


def environment_held(name: str) -> tuple[Copy, Kept] | None:
    """Return the copy that an environment is named by, and the component; None for any other name."""
    parsed = SimulationName.parse(name)
    if parsed.library not in {"gymnasium", "pettingzoo"} or not parsed.place.startswith("/"):
        return None
    return Copy.holding(Path(unquote(parsed.place)))


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
    if module is not None and file is not None and kind.__module__.startswith((*_SCRIPTS, FROM_FILE)):
        path = str(Path(file).resolve())
        files.setdefault(path, module)
        return f"{path}:{kind.__name__}"
    return f"{kind.__module__}:{kind.__name__}"
