"""Finds the class of a simulation: `package.module:Class`, `path/to/file.py:Class`, or an adapter's."""

import importlib
import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from swarmwright._errors import InputError
from swarmwright._own._base import Described, Simulation
from swarmwright._own._batch import BatchSimulation
from swarmwright._own._names import FROM_FILE, files
from swarmwright._suggest import did_you_mean
from swarmwright.adapters._name import is_adapted

serving = False
"""Whether this process is a simulation server, which imports a module only for its class."""


def load(name: str, folder: Path | None = None) -> type[Simulation] | type[BatchSimulation]:
    """Import the module and return the class.

    Args:
        name: see above. Modules are looked for where Python looks for them, then in the working folder.
        folder: that paths are relative to; default: the working folder.

    Raises InputError: there is no such file, module, class or environment, or importing it fails.
    """
    if is_adapted(name):
        from swarmwright import adapters

        _look_in(Path.cwd())
        return adapters.simulation(name)
    place, _, wanted = name.rpartition(":")
    module = _file((folder or Path()) / place) if place.endswith(".py") else _module(place)
    found = getattr(module, wanted, None)
    if isinstance(found, type) and issubclass(found, Simulation | BatchSimulation):
        return found
    classes = [
        key
        for key, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Described)
        and value not in {Described, Simulation, BatchSimulation}
    ]
    where = getattr(module, "__file__", None) or place
    if found is not None:
        raise InputError(f"{where}: {wanted} is not a subclass of swarmwright.Simulation")
    there = f"there is: {', '.join(classes)}" if classes else "no subclass of swarmwright.Simulation is there"
    raise InputError(f"{where}: has no class {wanted!r}{did_you_mean(wanted, classes) or ';'} {there}")


def _file(path: Path) -> ModuleType:
    path = path.resolve()
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    key = str(path)
    if key not in files:
        _look_in(path.parent)
        # A name that no import statement can have, so that it hides no other module.
        spec = importlib.util.spec_from_file_location(f"{FROM_FILE}{path}", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # dataclasses and pickle look there
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            del sys.modules[spec.name]
            if isinstance(error, InputError):  # what it needs is not there
                raise
            raise InputError(_failure(key, error)) from error
        files[key] = module
    return files[key]


def _module(name: str) -> ModuleType:
    _look_in(Path.cwd())
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise InputError(
                f"there is no module {name!r} here or among Python's; "
                f"a file is named like path/to/{name.rpartition('.')[2]}.py:Class"
            ) from error
        raise InputError(_failure(name, error)) from error
    except InputError:  # what it needs is not there
        raise
    except Exception as error:  # a user's code may fail in any way
        raise InputError(_failure(name, error)) from error


def _look_in(folder: Path) -> None:
    """Let modules be found in a folder, after all others: nothing in it can hide one."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))


def _failure(name: str, error: Exception) -> str:
    """Say what went wrong while a module was imported, and where."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}:{error.lineno}: {error.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<")
        and frame.filename != __file__
        and "importlib" not in frame.filename
    ]
    place = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else name
    return f"{place}: {type(error).__name__} while it is imported: {error}"
