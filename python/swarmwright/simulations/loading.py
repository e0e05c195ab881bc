"""Finds the class of a simulation: `package.module:Class`, `path/to/file.py:Class`, or an adapter's.

Classes of environments that are named as if they were simulations, `my_world.py:Maze`.
"""

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
from swarmwright.common.files import near_file
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.tracebacks import words_of
from swarmwright.simulations import isolation
from swarmwright.simulations.base import BatchSimulation, Described, Simulation
from swarmwright.simulations.names import (
    FROM_FILE,
    environment_held,
    files,
    module_name,
    module_name_beside,
    place_of_module,
)
from swarmwright.simulations.physics import Kind, Physics
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.changes import choose, copy_is_used
from swarmwright.simulations.user_code.copying import FOLDER as CODE
from swarmwright.simulations.user_code.copying import Copy, Kept
from swarmwright.simulations.user_code.imports import Walk
from swarmwright.simulations.user_code.parts import Part, of_simulation
from swarmwright.simulations.user_code.permission import require_copy, require_file, require_named

_GUIDE = "see docs/how-to/use-environments.md"


def as_environment(found: object, name: str) -> str:
    """Return how an environment of Gymnasium or PettingZoo is named instead, empty for any other object.

    Args:
        found: what has the name.
        name: of its file or module, and of the class.
    """
    if not isinstance(found, type):
        return ""
    parsed = SimulationName.parse(name)
    module = parsed.module if parsed.file is None else parsed.file.stem
    for base in found.__mro__:
        library = base.__module__.partition(".")[0]
        if library == "gymnasium" and base.__name__ == "Env":
            return _of_gymnasium(found, module, parsed.member)
        if library == "pettingzoo" and base.__name__ in {"ParallelEnv", "AECEnv"}:
            return (
                f"is an environment of PettingZoo, which needs no class of a simulation: let parallel_env() "
                f"of the module return one, and write pettingzoo:{module}; {_GUIDE}"
            )
    return ""


def _of_gymnasium(found: type, module: str, member: str) -> str:
    """Return the name under which it is registered, or else how that is done."""
    what = "is an environment of Gymnasium, which needs no class of a simulation"
    entry = f"{module}:{member}"
    # It is imported, as its class is derived from one of it.
    for registered, spec in sys.modules["gymnasium"].registry.items():
        if spec.entry_point in {found, entry}:
            return f"{what}: write gymnasium:{module}:{registered}; {_GUIDE}"
    return (
        f"{what}: register it in its module, gymnasium.register('{member}-v0', entry_point='{entry}'), and "
        f"write gymnasium:{module}:{member}-v0; {_GUIDE}"
    )


_stamps: dict[str, dict[Path, tuple[int, int] | None]] = {}
"""Path of a file -> that and its neighbours as they were when it was imported."""

_importing: dict[str, int] = {}
"""Path of a file that is being imported -> the thread that does it."""

_looked_in: set[str] = set()
"""Folders that were added to `sys.path` here."""

_digests: dict[str, tuple[ModuleType, str]] = {}
"""Path of a file -> its module, and the SHA-256 of the source of that."""

_environments: dict[str, type[Simulation]] = {}
"""Name of an environment in a run's copy -> its class."""

serving = False
"""Whether this process is a simulation server, which imports a module only for its class."""


def load(name: str, folder: Path | None = None) -> Kind:
    """Import the module and return the class.

    A file that is a run's copy means the class of that run: the original file is used if it has not changed,
    else the copy.

    Args:
        name: see above. Modules are looked for where Python looks for them, then, if they are not
            there, in the working folder.
        folder: that paths are relative to; default: the working folder.

    Raises InputError: there is no such file, module, class or environment, or importing it fails.
    """
    parsed = SimulationName.parse(name)
    if parsed.module.startswith(FROM_FILE):
        raise InputError(f"{name!r}: name the file of the class itself: path/to/file.py:Class")
    held = environment_held(name)
    if held is not None:
        return _kept_environment(name, *held)
    if parsed.is_environment or parsed.is_command:
        if parsed.file is not None:
            name = _kept_command(parsed.in_file(((folder or Path()) / parsed.file).absolute()))
        _look_here("" if parsed.library == "vmas" else parsed.module)
        # By name, as plug-ins are: adapters are simulations, above this module.
        adapted: type[Simulation | BatchSimulation] = importlib.import_module(
            "swarmwright.simulations.attached"
        ).load_adapter(name)
        return adapted
    wanted = parsed.member
    if not parsed.place or not wanted:
        raise InputError(
            f"{name!r} names no class: expected path/to/file.py:Class, package.module:Class or an environment"
        )
    if parsed.file is not None:
        module = _from_file(((folder or Path()) / parsed.file).resolve())
    else:
        module = _module(parsed.module)
    found = getattr(module, wanted, None)
    if isinstance(found, type) and issubclass(found, Simulation | BatchSimulation | Physics):
        return found
    classes = _classes(module)
    where = getattr(module, "__file__", None) or parsed.place
    if found is not None:
        other = as_environment(found, name) or "is not a subclass of swarmwright.Simulation"
        raise InputError(f"{where}: {wanted} {other}")
    there = f"available: {', '.join(classes)}" if classes else "it has no subclass of swarmwright.Simulation"
    raise InputError(f"{where}: has no class {wanted!r}{did_you_mean(wanted, classes) or ';'} {there}")


def classes_of_file(path: Path) -> list[str]:
    """Import a file as `load` does; return the names of its simulations.

    Raises InputError: there is no such file, importing it fails, or it is a run's and not trusted.
    """
    return _classes(_from_file(path.resolve()))


def _classes(module: ModuleType) -> list[str]:
    return [
        key
        for key, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Described | Physics)
        and value not in {Described, Simulation, BatchSimulation, Physics}
    ]


def _kept_command(name: str) -> str:
    """Return the command that a name means: of a run's copy the original, as long as that is the same."""
    parsed = SimulationName.parse(name)
    held = None if parsed.file is None else Copy.holding(parsed.file)
    if held is None:
        return name
    copy, kept = held
    now = of_simulation(name)
    if now is None or now.digests.get(kept.main) != kept.digests[kept.main]:
        # The files are those of the copy, but the command is another one.
        if not _is_started_by_another():
            require_named(name)
        return name
    choice = choose(copy, kept)
    if not _is_started_by_another():
        require_copy(copy, kept, choice)
        if choice.copied and choice.instead is not None:
            copy_is_used(copy, kept, choice.instead)
    return name if choice.copied else parsed.in_file(choice.part.origin)


def _kept_environment(name: str, copy: Copy, kept: Kept) -> type[Simulation]:
    """Return the class of an environment whose modules are a run's copy, which it imports."""
    if name not in _environments:
        if not _is_started_by_another():  # which has asked
            require_copy(copy, kept, choose(copy, kept))
        base = importlib.import_module("swarmwright.simulations.attached").load_adapter(kept.component)
        attributes = {
            "adapted": name,
            "isolated_modules": _apart(copy.folder / kept.name, _top(set(kept.digests) - kept.data)),
            "__module__": base.__module__,
            "__doc__": base.__doc__,
        }
        _environments[name] = type(base.__name__, (base,), attributes)
    return _environments[name]


def _top(places: Iterable[str]) -> set[str]:
    """Return the modules and packages at the top of a folder of modules."""
    return {place.partition("/")[0].partition(".")[0] for place in places}


def _apart(folder: Path, names: set[str]) -> isolation.IsolatedModules:
    """Return the modules of a folder, isolated; what they define can be pickled."""
    return isolation.IsolatedModules(folder, names, partial(module_name_beside, folder))


def module_named(name: str) -> ModuleType:
    """Import a module by the name that a process which imported its file knows it by.

    Worker processes do this when they unpickle what the file defines. Elsewhere the name could come from
    anywhere, so the file has to be trusted as one that a run folder names. Raises InputError.
    """
    path, inside = place_of_module(name)
    file = path / f"{inside.replace('.', '/')}.py" if inside else path
    if not _is_worker():
        held = Copy.holding(file)
        if held is None:
            require_file(f"{file}:")
        else:
            require_copy(*held, choose(*held))
    if not inside:
        return _from_file(path)
    names = {neighbour.stem for neighbour in path.iterdir() if neighbour.suffix in {"", ".py"}}
    with _explained(str(file)), _apart(path, names).activate():
        importlib.import_module(inside)
    return sys.modules[name]


def _is_worker() -> bool:
    """Whether another process started this one to work for it, and was allowed to run its code."""
    return current_process().name != "MainProcess"


def _is_started_by_another() -> bool:
    """Whether this is a server or a worker: the process that started it has asked for permission."""
    return serving or _is_worker()


def code_in(path: Path) -> tuple[ModuleType, str]:
    """Import a file, a run's copy as `load` does; return its module and the SHA-256 of its source.

    The SHA-256, in hexadecimal, is of the file and of what it imports, see `simulations.user_code`. Raises
    InputError: there is no such file, importing it fails, or it is a run's and not trusted.
    """
    path = path.resolve()
    module = _from_file(path)
    known = _digests.get(str(path))
    if known is None or known[0] is not module:
        held = Copy.holding(path)
        digests = held[1].digests if held is not None else Part.of_file("", "", path).digests
        known = _digests[str(path)] = (module, trust.digest_of(digests))
    return known


def file_with(folder: Path, name: str, sha256: str) -> Path | None:
    """Return the file with some source, in a folder or in the copies of a run there; None without one.

    name: of the file alone. sha256: as `code_in` returns it. Raises InputError when it is not trusted.
    """
    if Path(name).name != name:
        return None
    for path in sorted((folder / CODE).glob(f"*/*/{name}")):
        held = Copy.holding(path.absolute())
        if held is not None and trust.digest_of(held[1].digests) == sha256:
            return path.absolute()
    path = (folder / name).absolute()
    if path.is_file():
        digests = Part.of_file("", "", path).digests
        if trust.digest_of(digests) == sha256:
            trust.require(digests, path)
            return path
    return None


def file_of(kind: type) -> Path | None:
    """Return the file in which a class is defined; None for one of a notebook."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return None if file is None else Path(file).resolve()


def _from_file(path: Path) -> ModuleType:
    held = Copy.holding(path)
    return _file(path) if held is None else _import_copy(*held)


def _import_copy(copy: Copy, kept: Kept) -> ModuleType:
    """Import what a run has a copy of: the one place where code that lies in a run folder is executed."""
    place = str(copy.place(kept))
    if place in files:
        return files[place]
    choice = choose(copy, kept)
    if not _is_started_by_another():  # which has asked
        require_copy(copy, kept, choice)
    if not choice.copied:
        part = choice.part
        return _file(part.origin) if part.module is None else _module(part.module)
    if choice.instead is not None and not _is_started_by_another():
        copy_is_used(copy, kept, choice.instead)
    code = [digest for digest in kept.digests if digest not in kept.data]
    places = [path for path in code if kept.module is not None or path != kept.main]
    apart = _apart(copy.folder / kept.name, _top(places))
    if kept.module is not None and "." in kept.module:
        with apart.activate():
            files[place] = _module(kept.module)
    else:
        with _explained(place):
            files[place] = apart.load(module_name(Path(place)), Path(place))
    return files[place]


@contextmanager
def _explained(name: str) -> Iterator[None]:
    """Turn what a module's code raises into an InputError: a user's code may fail in any way."""
    try:
        yield
    except InputError:  # what it needs is not there
        raise
    # Also `sys.exit`, which would end the process without a word.
    except (Exception, SystemExit) as error:
        raise InputError(_failure(name, error)) from error


def _file(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file{near_file(path)}")
    key = str(path)
    if key in files and _stamps.get(key, {}) != _stamped(_stamps.get(key, {})):
        _forget(key)
    if key not in files:
        if _importing.get(key) == threading.get_ident():
            raise ImportError(
                "the file is named by an experiment while it is imported; put what starts a run under "
                '`if __name__ == "__main__":`'
            )
        with _explained(key):
            walk = Walk.of_file(path)
        _without_stale_bytecode(walk.files.values())
        _importing[key] = threading.get_ident()
        try:
            files[key] = _executed(path, walk.hidden())
        finally:
            _importing.pop(key, None)
        _stamps[key] = _stamped(walk.files.values())
    return files[key]


def _executed(path: Path, hidden: set[str]) -> ModuleType:
    """Run a file and return its module.

    hidden: modules beside the file by whose names the process knows others: the file gets its own.
    """
    # A name that no import statement can have, so that it hides no other module.
    name = module_name(path)
    with _explained(str(path)):
        if hidden:
            return _apart(path.parent, hidden).load(name, path)
        _look_in(path.parent)
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


def _stamped(paths: Iterable[Path]) -> dict[Path, tuple[int, int] | None]:
    """Return time and size of files, by which edits are detected."""
    found: dict[Path, tuple[int, int] | None] = {}
    for path in paths:
        try:
            status = path.stat()
        except OSError:
            found[path] = None
        else:
            found[path] = status.st_mtime_ns, status.st_size
    return found


def _forget(key: str) -> None:
    """Let a file that was edited, or whose neighbours were, be imported anew: in a notebook, for instance."""
    neighbours = {str(path) for path in _stamps.pop(key)}
    for name, module in list(sys.modules.items()):
        if name != "__main__" and getattr(module, "__file__", None) in neighbours:
            del sys.modules[name]
    del files[key]
    importlib.invalidate_caches()


def _without_stale_bytecode(paths: Iterable[Path]) -> None:
    """Delete compiled code that is older than its file.

    Python would take it for the file's where the size is the same and both are of the same second: when a
    neighbour is edited right after it was imported.
    """
    for path in paths:
        with suppress(OSError, NotImplementedError):
            compiled = Path(importlib.util.cache_from_source(str(path)))
            if compiled.stat().st_mtime_ns <= path.stat().st_mtime_ns:
                compiled.unlink()


def _module(name: str) -> ModuleType:
    _look_here(name)
    with _explained(name):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise
            raise InputError(
                f"there is no module {name!r} in the working folder, {Path.cwd()}, or among Python's; "
                f"a file is named like path/to/{name.rpartition('.')[2]}.py:Class"
            ) from error


def _look_in(folder: Path) -> None:
    """Let modules be found in a folder, after all others: nothing in it can hide one."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
        _looked_in.add(str(folder))


def _look_here(module: str) -> None:
    """Let a module be found in the working folder, before folders of files that were loaded earlier.

    Do nothing for a module that Python finds elsewhere, and for none (""): installed packages would otherwise
    import optional dependencies that are not installed from the working folder, which may be a run folder of
    another user.
    """
    name = module.partition(".")[0]
    if not name or _is_elsewhere(name):
        return
    here = str(Path.cwd())
    if here in _looked_in and here in sys.path:
        sys.path.remove(here)
    if here not in sys.path:
        # Others may have taken folders out again.
        places = [place for place, folder in enumerate(sys.path) if folder in _looked_in]
        sys.path.insert(min(places, default=len(sys.path)), here)
        _looked_in.add(here)


def _is_elsewhere(name: str) -> bool:
    """Whether Python finds a module or package without the folders that were added here."""
    others = [folder for folder in sys.path if folder not in _looked_in]
    if PathFinder.find_spec(name, others) is not None:
        return True
    return any(
        finder is not PathFinder and finder.find_spec(name, None) is not None for finder in sys.meta_path
    )


def _failure(name: str, error: BaseException) -> str:
    """Say what went wrong while a module was imported, and where."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}:{error.lineno}: {error.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<")
        and frame.filename not in {__file__, isolation.__file__}
        and "importlib" not in frame.filename
    ]
    if isinstance(error, SwarmwrightError | ImportError):  # which says what is wrong with the file's own line
        frames = [frame for frame in frames if frame.filename == name] or frames
    place = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else name
    if isinstance(error, ImportError) and (
        FROM_FILE.rstrip(".") in str(error) or "beyond top-level package" in str(error)
    ):
        return f"{place}: {_relative_import(Path(frames[-1].filename if frames else name))}"
    said = words_of(error)
    words = f": {said}" if said.strip() else ""
    return f"{place}: {type(error).__name__} while it is imported{words}"


def _relative_import(path: Path) -> str:
    """Say how to name a class whose file imports others of its package by their place, `from . import`."""
    root = path.parent
    while (root / "__init__.py").is_file():
        root = root.parent
    if root == path.parent:  # a package without this file
        root = root.parent
    module = ".".join(path.relative_to(root).with_suffix("").parts)
    return (
        "a relative import needs a package, and a file that is named by its path is imported without one; "
        f"name the class by its module, {module}:Class, and start in {root}, or import without the dot: "
        "modules beside the file are found"
    )
