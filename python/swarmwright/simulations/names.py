"""Names of user-defined simulations: resolving a name, and naming a class."""

import os
import sys
from pathlib import Path
from types import ModuleType
from urllib.parse import quote, unquote, unquote_to_bytes

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.user_code.copying import FOLDER as CODE
from swarmwright.simulations.user_code.copying import CopiedPart, Copy, list_paths_beside

FROM_FILE = "swarmwright_files."
"""Prefix of the names of modules that are named by their file, see that package."""
_SCRIPTS = ("__main__", "__mp_main__")
"""Names of a script's module, in its own process and in processes started by multiprocessing."""
files: dict[str, ModuleType] = {}
"""Path of a file -> its module."""


def module_name(file: Path) -> str:
    """Return the name by which any process can import the module of a file."""
    return f"{FROM_FILE}{_quote(os.fsencode(file))}"


def module_name_beside(folder: Path, module: str) -> str:
    """Return the name by which any process can import a module of a folder of isolated modules."""
    return f"{module_name(folder)}:{_quote(module.encode())}"


def parse_module_name(name: str) -> tuple[Path, str]:
    """Return the file and "" for a name of `module_name`, else the folder and the module in it."""
    path, _, module = name.removeprefix(FROM_FILE).partition(":")
    return Path(os.fsdecode(unquote_to_bytes(path))), unquote(module)


def _quote(text: bytes) -> str:
    """Quote a text as a part of a module's name, which may not contain dots or colons."""
    return quote(text, safe="/").replace(".", "%2E")


def make_absolute(name: str, folder: Path | None = None) -> str:
    """Return a name with its file, if any, as an absolute path."""
    parsed = SimulationName.parse(name)
    return name if parsed.file is None else parsed.with_file(((folder or Path()) / parsed.file).resolve())


def make_relative(name: str, folder: Path) -> str:
    """Return a name with its file, if any, relative to the folder of an experiment file."""
    parsed = SimulationName.parse(name)
    if parsed.file is None:
        return name
    try:
        return parsed.with_file(Path(os.path.relpath(parsed.file, folder)))
    except ValueError:  # on another drive
        return name


def resolve_run_name(name: str, run: Path) -> str:
    """Return the absolute name of a run's simulation.

    If the copy in the run folder was deleted, a file in or beside the folder takes precedence over the
    original path, because a folder may be copied together with its file.
    """
    parsed = SimulationName.parse(name)
    file = parsed.file
    if file is not None and not (run / CODE in (run / file).parents and (run / file).exists()):
        for path in list_paths_beside(run.resolve(), file):
            if path.is_file():
                return parsed.with_file(path)
    return make_absolute(name, run)


def format_environment_copy(copy: Copy, copied: CopiedPart) -> str:
    """Return the name of an environment in a run's copy, which has its file instead of the module.

    `gymnasium:/runs/a/code/1/simulation/maze.py:Maze-v0`
    """
    parsed = SimulationName.parse(copied.component)
    environment = f":{parsed.location.rpartition(':')[2]}" if parsed.library == "gymnasium" else ""
    options = f"?{parsed.query}" if parsed.query else ""
    return f"{parsed.library}:{quote(str(copy.main_path(copied).absolute()))}{environment}{options}"


def find_environment_copy(name: str) -> tuple[Copy, CopiedPart] | None:
    """Return the copy and the component that an environment's name refers to; None for other names."""
    parsed = SimulationName.parse(name)
    if parsed.library not in {"gymnasium", "pettingzoo"} or not parsed.location.startswith("/"):
        return None
    return Copy.find_containing(Path(unquote(parsed.location)))


def name_of(kind: type) -> str:
    """Return the name by which other processes find a class.

    Classes of a script are found in its file; those of a notebook, __main__:Class, only in this process.
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
