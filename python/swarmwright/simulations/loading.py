"""Loading of a simulation's class: `package.module:Class`, `path/to/file.py:Class`, or an adapter's name."""

import importlib
import importlib.util
import sys
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib.machinery import PathFinder
from multiprocessing import current_process
from pathlib import Path
from types import ModuleType

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.files import suggest_file
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.tracebacks import exception_text
from swarmwright.simulations import isolation
from swarmwright.simulations.base import BatchSimulation, Described, Simulation
from swarmwright.simulations.names import (
    FROM_FILE,
    files,
    find_environment_copy,
    module_name,
    module_name_beside,
    parse_module_name,
)
from swarmwright.simulations.physics import Kind, Physics
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.changes import choose, warn_of_copy
from swarmwright.simulations.user_code.copying import FOLDER as CODE
from swarmwright.simulations.user_code.copying import CopiedPart, Copy
from swarmwright.simulations.user_code.imports import Walk
from swarmwright.simulations.user_code.parts import Part, read_simulation
from swarmwright.simulations.user_code.permission import require_copy, require_file, require_named

_GUIDE = "see docs/how-to/use-environments.md"


def suggest_environment_name(value: object, name: str) -> str:
    """Return how to name an environment of Gymnasium or PettingZoo; empty for any other object.

    Args:
        value: the object.
        name: the name of its file or module and of the class.
    """
    if not isinstance(value, type):
        return ""
    parsed = SimulationName.parse(name)
    module = parsed.module if parsed.file is None else parsed.file.stem
    for base in value.__mro__:
        library = base.__module__.partition(".")[0]
        if library == "gymnasium" and base.__name__ == "Env":
            return _suggest_gymnasium_name(value, module, parsed.member)
        if library == "pettingzoo" and base.__name__ in {"ParallelEnv", "AECEnv"}:
            function = "env" if base.__name__ == "AECEnv" else "parallel_env"
            return (
                "is a PettingZoo environment, which needs no simulation class: return it from "
                f"{function}() in the module, and write pettingzoo:{module}; {_GUIDE}"
            )
    return ""


def _suggest_gymnasium_name(kind: type, module: str, member: str) -> str:
    """Return the name under which an environment is registered, or else how to register it."""
    problem = "is a Gymnasium environment, which needs no simulation class"
    entry = f"{module}:{member}"
    # Gymnasium has been imported, because the class is derived from one of its classes.
    for registered, spec in sys.modules["gymnasium"].registry.items():
        if spec.entry_point in {kind, entry}:
            return f"{problem}: write gymnasium:{module}:{registered}; {_GUIDE}"
    return (
        f"{problem}: register it in its module, gymnasium.register('{member}-v0', entry_point='{entry}'), "
        f"and write gymnasium:{module}:{member}-v0; {_GUIDE}"
    )


_stamps: dict[str, dict[Path, tuple[int, int] | None]] = {}
"""Path of a file -> stamps of the file and its neighbours when it was imported."""

_importing: dict[str, int] = {}
"""Path of a file that is being imported -> the importing thread."""

_added_folders: set[str] = set()
"""Folders that this module added to `sys.path`."""

_digests: dict[str, tuple[ModuleType, str]] = {}
"""Path of a file -> its module, and the SHA-256 of its source."""

_environments: dict[str, type[Simulation]] = {}
"""Name of an environment in a run's copy -> its class."""

serving = False
"""Whether this process is a simulation server, which imports a module only for its class."""


def load(name: str, folder: Path | None = None) -> Kind:
    """Import the module and return the class.

    A file in a run's copy stands for the class of that run: the original file is loaded if it has not
    changed, else the copy.

    Args:
        name: see above. Modules are searched in Python's path, then in the working folder.
        folder: folder that paths are relative to; default: the working folder.

    Raises InputError if the file, module, class or environment does not exist, or importing it fails.
    """
    parsed = SimulationName.parse(name)
    if parsed.module.startswith(FROM_FILE):
        raise InputError(f"{name!r}: name the file of the class instead: path/to/file.py:Class")
    environment_copy = find_environment_copy(name)
    if environment_copy is not None:
        return _load_environment_copy(name, *environment_copy)
    if parsed.is_environment or parsed.is_command:
        if parsed.file is not None:
            name = _choose_command(parsed.with_file(((folder or Path()) / parsed.file).absolute()))
        _add_working_folder("" if parsed.library == "vmas" else parsed.module)
        # Imported by name, because adapters depend on this module.
        adapted: type[Simulation | BatchSimulation] = importlib.import_module(
            "swarmwright.simulations.attached"
        ).load_adapter(name)
        return adapted
    member = parsed.member
    if not parsed.location or not member:
        raise InputError(
            f"{name!r} does not name a class; expected path/to/file.py:Class, package.module:Class or an "
            "environment"
        )
    if parsed.file is not None:
        module = _import_file_or_copy(((folder or Path()) / parsed.file).resolve())
    else:
        module = _import_module(parsed.module)
    value = getattr(module, member, None)
    if isinstance(value, type) and issubclass(value, Simulation | BatchSimulation | Physics):
        return value
    classes = _classes(module)
    where = getattr(module, "__file__", None) or parsed.location
    if value is not None:
        problem = suggest_environment_name(value, name) or "is not a subclass of swarmwright.Simulation"
        raise InputError(f"{where}: {member} {problem}")
    available = (
        f"available: {', '.join(classes)}" if classes else "it has no subclass of swarmwright.Simulation"
    )
    raise InputError(f"{where}: has no class {member!r}{did_you_mean(member, classes) or ';'} {available}")


def classes_of_file(path: Path) -> list[str]:
    """Import a file like `load`; return the names of its simulations.

    Raises InputError if it does not exist, importing it fails, or it belongs to a run and is not trusted.
    """
    return _classes(_import_file_or_copy(path.resolve()))


def _classes(module: ModuleType) -> list[str]:
    return [
        key
        for key, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Described | Physics)
        and value not in {Described, Simulation, BatchSimulation, Physics}
    ]


def _choose_command(name: str) -> str:
    """Return the name of a command: for a run's copy, the original unless that has changed."""
    parsed = SimulationName.parse(name)
    containing = None if parsed.file is None else Copy.find_containing(parsed.file)
    if containing is None:
        return name
    copy, copied = containing
    current = read_simulation(name)
    if current is None or current.digests.get(copied.main) != copied.digests[copied.main]:
        # The files are those of the copy, but the command differs.
        if not _is_started_by_another():
            require_named(name)
        return name
    choice = choose(copy, copied)
    if not _is_started_by_another():
        require_copy(copy, copied, choice)
        if choice.copied and choice.current is not None:
            warn_of_copy(copy, copied, choice.current)
    return name if choice.copied else parsed.with_file(choice.part.origin)


def _load_environment_copy(name: str, copy: Copy, copied: CopiedPart) -> type[Simulation]:
    """Return the class of an environment that imports its modules from a run's copy."""
    if name not in _environments:
        if not _is_started_by_another():  # the other process has asked
            require_copy(copy, copied, choose(copy, copied))
        base = importlib.import_module("swarmwright.simulations.attached").load_adapter(copied.component)
        attributes = {
            "adapted": name,
            "isolated_modules": _isolate(
                copy.folder / copied.name, _get_top_level_names(set(copied.digests) - copied.data)
            ),
            "__module__": base.__module__,
            "__doc__": base.__doc__,
        }
        _environments[name] = type(base.__name__, (base,), attributes)
    return _environments[name]


def _get_top_level_names(locations: Iterable[str]) -> set[str]:
    """Return the names of the top-level modules and packages of locations."""
    return {location.partition("/")[0].partition(".")[0] for location in locations}


def _isolate(folder: Path, names: set[str]) -> isolation.IsolatedModules:
    """Return the isolated modules of a folder, whose objects can be pickled."""
    return isolation.IsolatedModules(folder, names, partial(module_name_beside, folder))


def import_by_name(name: str) -> ModuleType:
    """Import a module by the name it has in a process that has imported its file.

    Worker processes do this to unpickle objects of the file's classes. In other processes the name may come
    from anyone, so the file must be trusted like a file named by a run folder. Raises InputError.
    """
    path, inside = parse_module_name(name)
    file = path / f"{inside.replace('.', '/')}.py" if inside else path
    if not _is_worker():
        containing = Copy.find_containing(file)
        if containing is None:
            require_file(f"{file}:")
        else:
            require_copy(*containing, choose(*containing))
    if not inside:
        return _import_file_or_copy(path)
    names = {neighbour.stem for neighbour in path.iterdir() if neighbour.suffix in {"", ".py"}}
    with _convert_import_errors(str(file)), _isolate(path, names).activate():
        importlib.import_module(inside)
    return sys.modules[name]


def _is_worker() -> bool:
    """Return whether this is a worker process, whose parent was allowed to run the code."""
    return current_process().name != "MainProcess"


def _is_started_by_another() -> bool:
    """Return whether this is a server or a worker, for which the parent has asked for permission."""
    return serving or _is_worker()


def import_with_digest(path: Path) -> tuple[ModuleType, str]:
    """Import a file, or a run's copy like `load`; return its module and the SHA-256 of its source.

    The SHA-256, in hexadecimal, covers the file and its imports, see `simulations.user_code`. Raises
    InputError if the file does not exist, importing it fails, or it belongs to a run and is not trusted.
    """
    path = path.resolve()
    module = _import_file_or_copy(path)
    entry = _digests.get(str(path))
    if entry is None or entry[0] is not module:
        containing = Copy.find_containing(path)
        digests = containing[1].digests if containing is not None else Part.from_file("", "", path).digests
        entry = _digests[str(path)] = (module, trust.digest_of(digests))
    return entry


def find_file(folder: Path, name: str, sha256: str) -> Path | None:
    """Return the file with a source, in a folder or in the copies of a run there; None if there is none.

    name: name of the file without folders. sha256: as `import_with_digest` returns it. Raises InputError if
    the file is not trusted.
    """
    if Path(name).name != name:
        return None
    for path in sorted((folder / CODE).glob(f"*/*/{name}")):
        containing = Copy.find_containing(path.absolute())
        if containing is not None and trust.digest_of(containing[1].digests) == sha256:
            return path.absolute()
    path = (folder / name).absolute()
    if path.is_file():
        digests = Part.from_file("", "", path).digests
        if trust.digest_of(digests) == sha256:
            trust.require(digests, path)
            return path
    return None


def file_of(kind: type) -> Path | None:
    """Return the file that defines a class; None for a class of a notebook."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return None if file is None else Path(file).resolve()


def _import_file_or_copy(path: Path) -> ModuleType:
    containing = Copy.find_containing(path)
    return _import_file(path) if containing is None else _import_copy(*containing)


def _import_copy(copy: Copy, copied: CopiedPart) -> ModuleType:
    """Import a component of a run's copy: the only function that executes code in a run folder."""
    main_path = str(copy.main_path(copied))
    if main_path in files:
        return files[main_path]
    choice = choose(copy, copied)
    if not _is_started_by_another():  # the other process has asked
        require_copy(copy, copied, choice)
    if not choice.copied:
        part = choice.part
        return _import_file(part.origin) if part.module is None else _import_module(part.module)
    if choice.current is not None and not _is_started_by_another():
        warn_of_copy(copy, copied, choice.current)
    code = [digest for digest in copied.digests if digest not in copied.data]
    locations = [location for location in code if copied.module is not None or location != copied.main]
    isolated = _isolate(copy.folder / copied.name, _get_top_level_names(locations))
    if copied.module is not None and "." in copied.module:
        with isolated.activate():
            files[main_path] = _import_module(copied.module)
    else:
        with _convert_import_errors(main_path):
            files[main_path] = isolated.load(module_name(Path(main_path)), Path(main_path))
    return files[main_path]


@contextmanager
def _convert_import_errors(name: str) -> Iterator[None]:
    """Turn exceptions of a module's code into InputError."""
    try:
        yield
    except InputError:  # a prerequisite is missing
        raise
    # Also `sys.exit`, which would end the process without a message.
    except (Exception, SystemExit) as error:
        raise InputError(_describe_failure(name, error)) from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file{suggest_file(path)}")
    key = str(path)
    if key in files and _stamps.get(key, {}) != _read_stamps(_stamps.get(key, {})):
        _forget(key)
    if key not in files:
        if _importing.get(key) == threading.get_ident():
            raise ImportError(
                "the file starts a run of itself while it is imported; put that code under "
                '`if __name__ == "__main__":`'
            )
        with _convert_import_errors(key):
            walk = Walk.from_file(path)
        _delete_stale_bytecode(walk.files.values())
        _importing[key] = threading.get_ident()
        try:
            files[key] = _execute_file(path, walk.find_shadowed_modules())
        finally:
            _importing.pop(key, None)
        _stamps[key] = _read_stamps(walk.files.values())
    return files[key]


def _execute_file(path: Path, hidden: set[str]) -> ModuleType:
    """Run a file and return its module.

    hidden: names of modules beside the file that the process has other modules for; they are isolated.
    """
    # A name that no import statement can have, so that it does not hide another module.
    name = module_name(path)
    with _convert_import_errors(str(path)):
        if hidden:
            return _isolate(path.parent, hidden).load(name, path)
        _append_to_path(path.parent)
        loader = isolation.FromSource(name, str(path))
        spec = importlib.util.spec_from_file_location(name, path, loader=loader)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses and pickle look there
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
        return module


def _read_stamps(paths: Iterable[Path]) -> dict[Path, tuple[int, int] | None]:
    """Return time and size of files, to detect edits."""
    stamps: dict[Path, tuple[int, int] | None] = {}
    for path in paths:
        try:
            status = path.stat()
        except OSError:
            stamps[path] = None
        else:
            stamps[path] = status.st_mtime_ns, status.st_size
    return stamps


def _forget(key: str) -> None:
    """Forget a file and its neighbours after an edit, so that they are imported again, as in a notebook."""
    neighbours = {str(path) for path in _stamps.pop(key)}
    for name, module in list(sys.modules.items()):
        if name != "__main__" and getattr(module, "__file__", None) in neighbours:
            del sys.modules[name]
    del files[key]
    importlib.invalidate_caches()


def _delete_stale_bytecode(paths: Iterable[Path]) -> None:
    """Delete bytecode that is older than its file.

    Python would use it if the size and the second of the modification are the same, as when a neighbour is
    edited right after it was imported.
    """
    for path in paths:
        with suppress(OSError, NotImplementedError):
            compiled = Path(importlib.util.cache_from_source(str(path)))
            if compiled.stat().st_mtime_ns <= path.stat().st_mtime_ns:
                compiled.unlink()


def _import_module(name: str) -> ModuleType:
    _add_working_folder(name)
    with _convert_import_errors(name):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise
            raise InputError(
                f"there is no module {name!r} in the working folder, {Path.cwd()}, or in Python's path; "
                f"to name a file, write path/to/{name.rpartition('.')[2]}.py:Class"
            ) from error


def _append_to_path(folder: Path) -> None:
    """Append a folder to Python's path, so that its modules cannot hide others."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
        _added_folders.add(str(folder))


def _add_working_folder(module: str) -> None:
    """Add the working folder to Python's path, before folders of files that were loaded earlier.

    Do nothing for a module that Python finds elsewhere, and for "": installed packages would otherwise import
    missing optional dependencies from the working folder, which may be another user's run folder.
    """
    name = module.partition(".")[0]
    if not name or _is_found_without_added_folders(name):
        return
    folder = str(Path.cwd())
    if folder in _added_folders and folder in sys.path:
        sys.path.remove(folder)
    if folder not in sys.path:
        # Other code may have removed folders.
        indices = [index for index, entry in enumerate(sys.path) if entry in _added_folders]
        sys.path.insert(min(indices, default=len(sys.path)), folder)
        _added_folders.add(folder)


def _is_found_without_added_folders(name: str) -> bool:
    """Return whether Python finds a module or package without the folders that this module added."""
    folders = [folder for folder in sys.path if folder not in _added_folders]
    if PathFinder.find_spec(name, folders) is not None:
        return True
    return any(
        finder is not PathFinder and finder.find_spec(name, None) is not None for finder in sys.meta_path
    )


def _describe_failure(name: str, error: BaseException) -> str:
    """Return the reason and the location of a failed import."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}:{error.lineno}: {error.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<")
        and frame.filename not in {__file__, isolation.__file__}
        and "importlib" not in frame.filename
    ]
    if isinstance(error, SwarmwrightError | ImportError):  # the message is about a line of the file itself
        frames = [frame for frame in frames if frame.filename == name] or frames
    location = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else name
    if isinstance(error, ImportError) and (
        FROM_FILE.rstrip(".") in str(error) or "beyond top-level package" in str(error)
    ):
        return f"{location}: {_explain_relative_import(Path(frames[-1].filename if frames else name))}"
    message = exception_text(error)
    words = f": {message}" if message.strip() else ""
    return f"{location}: {type(error).__name__} while it is imported{words}"


def _explain_relative_import(path: Path) -> str:
    """Return how to name a class whose file has relative imports, `from . import`."""
    root = path.parent
    while (root / "__init__.py").is_file():
        root = root.parent
    if root == path.parent:  # a package without this file
        root = root.parent
    module = ".".join(path.relative_to(root).with_suffix("").parts)
    return (
        "a relative import needs a package, but a file that is named by its path is imported without one; "
        f"name the class by its module, {module}:Class, and start in {root}, or import modules beside the "
        "file without the dot"
    )
