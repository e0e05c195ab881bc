"""The source of one component of an experiment as it is now.

Files that a simulation reads and an experiment names, `servers: {files: [maps/*.json]}`.
"""

import dataclasses
import hashlib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, label_of
from swarmwright.simulations.user_code.imports import Walk

SECTIONS = ("controller", "method", "ranking")
"""Sections of an experiment whose components may be plug-ins."""


MODULES = ("behaviour", "condition")
"""What in a `controller` of the kind `modules` may be plug-ins."""
_SEPARATOR = "-"


@dataclass(frozen=True)
class Source:
    """One file."""

    origin: Path
    data: bytes

    @property
    def digest(self) -> str:
        """SHA-256, in hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True)
class Part:
    """The source of one component."""

    name: str
    """simulation, controller, method or ranking; behaviour-NAME, condition-NAME"""
    component: str
    """What the experiment calls it: the class or environment, or the kind of a plug-in."""
    main: str
    """The file that holds it, one of `files`."""
    module: str | None
    """What it is imported as; None for a file that is loaded by its path."""
    files: Mapping[str, Source]
    """By their place below a folder of modules."""
    packages: frozenset[str]
    """Installed packages that it imports, by the names by which they are imported."""
    data: frozenset[str] = frozenset()
    """Those of `files` that it reads and does not import, see `data_files`."""
    patterns: tuple[str, ...] = ()
    """By which an experiment names them."""

    @property
    def digests(self) -> dict[str, str]:
        """Place -> SHA-256."""
        return {place: source.digest for place, source in self.files.items()}

    @property
    def in_file(self) -> bool:
        """Whether the experiment names it by its file."""
        return SimulationName.parse(self.component).file is not None

    @property
    def origin(self) -> Path:
        """The main file."""
        return self.files[self.main].origin

    @classmethod
    def of_file(cls, name: str, component: str, path: Path) -> Self:
        """Read what lies in a file and in those that it imports. Raises InputError."""
        return cls._read(name, component, path.name, None, lambda: Walk.of_file(path.resolve()))

    @classmethod
    def of_module(cls, name: str, component: str, module: str, *, installed: bool = True) -> Self | None:
        """Read the source of a module; None when there is none. Raises InputError."""
        part = cls._read(name, component, "", module, lambda: Walk.of_module(module, installed=installed))
        path = module.replace(".", "/")
        for main in (f"{path}.py", f"{path}/__init__.py"):
            if main in part.files:
                return cls(name, component, main, module, part.files, part.packages)
        return None

    @classmethod
    def of_command(cls, name: str) -> Self:
        """Read the files of a command and its definition. Raises InputError."""
        from swarmwright.simulations.command.checking import definition_of_name  # noqa: PLC0415 - pydantic, where there is a command
        from swarmwright.simulations.user_code import command_sources  # noqa: PLC0415 - as above

        options = definition_of_name(name)
        main, sources = command_sources.sources_of(options)
        origin = Path(options.folder).resolve() / SimulationName.DEFINITION
        files = {main: Source(origin, command_sources.definition_of(options))}
        for place, path in sources.items():
            try:
                files[place] = Source(path, path.read_bytes())
            except OSError as error:
                raise InputError(f"{path}: cannot be read: {error.strerror}") from error
        component = SimulationName.parse(name).in_file(SimulationName.DEFINITION)
        return cls("simulation", component, main, None, files, frozenset())

    @classmethod
    def _read(cls, name: str, component: str, main: str, module: str | None, walk: Any) -> Self:  # noqa: ANN401 - a function
        try:
            walked = walk()
            files = {place: Source(path, path.read_bytes()) for place, path in sorted(walked.files.items())}
        except OSError as error:
            raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error
        return cls(name, component, main, module, files, frozenset(walked.packages))


def of_simulation(name: str) -> Part | None:
    """Return the source of a simulation that is named by its class; None where there is none to keep.

    That is so for built-in ones and for classes of a notebook. Raises InputError when a file cannot be read.
    """
    parsed = SimulationName.parse(name)
    module = parsed.module
    if parsed.is_command:
        return Part.of_command(name)
    if parsed.is_environment:
        return Part.of_module("simulation", name, module, installed=False) if _importable(module) else None
    if parsed.file is not None:
        return Part.of_file("simulation", parsed.in_file(parsed.file.name), parsed.file)
    if module.partition(".")[0] in {"__main__", "swarmwright"} or not module:
        return None
    return Part.of_module("simulation", name, module)


def _importable(module: str) -> bool:
    return bool(module) and all(part.isidentifier() for part in module.split("."))


def is_plug_in(name: str) -> bool:
    """Whether a part is that of a plug-in: of a section of the experiment, or of a module of `modules`."""
    return name in SECTIONS or name.partition(_SEPARATOR)[0] in MODULES


def of_plug_in(section: str, kind: str) -> Part | None:
    """Return the source of a plug-in, None for what is built in. Raises InputError as the registry does."""
    what = section.partition(_SEPARATOR)[0]
    parsed = SimulationName.parse(kind)
    if parsed.file is not None:
        return Part.of_file(section, parsed.in_file(parsed.file.name), parsed.file)
    if what in MODULES:
        from swarmwright.controllers.modules.registered import REGISTRIES as OF_MODULES  # noqa: PLC0415 - NumPy, not for --help

        found = OF_MODULES[what].module(kind)
        return None if found is None else Part.of_module(section, kind, found)
    from swarmwright.methods.plug_ins import REGISTRIES  # noqa: PLC0415 - NumPy, not for --help

    module = REGISTRIES[section].module(kind)
    return None if module is None else Part.of_module(section, kind, module)


def part_of(what: str, name: str) -> str:
    """Return what the part of a module is called, where that is named so by an experiment."""
    return f"{what}{_SEPARATOR}{label_of(name)}"


def of_plug_ins(experiment: Any) -> list[Part]:  # noqa: ANN401 - an Experiment, which is above this
    """Return the sources of all plug-ins that an experiment uses."""
    sections = ((section, getattr(experiment, section)) for section in SECTIONS)
    # What is not installed here has no source, and needs none where its run is only read.
    names = [
        (name, options.kind)
        for name, options in sections
        if not getattr(options, "unavailable", False) or SimulationName.parse(options.kind).file is not None
    ]
    for what, name in getattr(experiment.controller, "plug_ins", ()):
        names.append((part_of(what, name), name))
    found = (of_plug_in(*part_name) for part_name in names)
    return [part for part in found if part is not None]


def distributions(parts: Iterable[Part]) -> tuple[str, ...]:
    """Return the installed packages that parts import, by the names under which they are installed."""
    names = sorted({name for part in parts for name in part.packages})
    known: Mapping[str, list[str]] | None = None
    found = []
    for name in names:
        try:
            version(name)
        except PackageNotFoundError:
            if known is None:
                known = packages_distributions()  # reads the lists of all files of all packages
            found += sorted(set(known.get(name, ())))
        else:
            found.append(name)
    return tuple(dict.fromkeys(found))


LARGEST_BYTES = 1 << 28
"""Bytes of all files of a simulation."""
_OF_A_RUN = ("run.sqlite", "run.sqlite.new")
"""By which a run folder is known."""


def home_of(part: Part) -> Path:
    """Return the folder that patterns are relative to: the one that modules of the part are found in."""
    return part.origin.parents[len(Path(part.main).parts) - 1]


def named_files(home: Path, patterns: Sequence[str]) -> list[Path]:
    """Return the files that patterns name.

    Raises InputError for a pattern without any, and one that leads out of the folder.
    """
    found: set[Path] = set()
    for pattern in patterns:
        if not _lies_inside(pattern):
            raise InputError(f"servers: files: {pattern!r} must lie in {home}, beside the simulation")
        try:
            matches = _matches(home, pattern)
        except (ValueError, NotImplementedError) as error:
            raise InputError(
                f"servers: files: {pattern!r} is no pattern: {error}; write a path, * for any name in one "
                "folder, or **/ for any folders"
            ) from None
        if not matches:
            raise InputError(
                f"servers: files: there is no file {pattern} in {home}, the folder from which the "
                f"simulation's code is imported{_left_out(pattern)}"
            )
        outside = next((path for path in matches if not _is_in(home, path)), None)
        if outside is not None:
            raise InputError(
                f"servers: files: {outside} leads through a link out of {home}, to {outside.resolve()}; put "
                "the file itself there, or name files without it"
            )
        found.update(matches)
    return sorted(found)


def with_data(part: Part, patterns: Sequence[str]) -> Part:
    """Return a part with the files that patterns name now; patterns without any are left out.

    Raises InputError when a file cannot be read, or there are too many.
    """
    if not patterns:
        return part
    home = home_of(part)
    paths = {path for pattern in patterns for path in _safe_matches(home, pattern)}
    places = {path.relative_to(home).as_posix(): path for path in sorted(paths)}
    places = {place: path for place, path in places.items() if place not in part.files or place in part.data}
    try:
        size = sum(path.stat().st_size for path in places.values())
    except OSError as error:
        raise InputError(f"servers: files: {error.filename}: cannot be read: {error.strerror}") from error
    if size > LARGEST_BYTES:
        raise too_large(size)
    data = {place: Source(path, read_named(path)) for place, path in places.items()}
    return dataclasses.replace(
        part,
        files={**part.files, **data},
        data=part.data | frozenset(data),
        patterns=tuple(dict.fromkeys([*part.patterns, *patterns])),
    )


def too_large(size: int) -> InputError:
    """Return the error for files of so many bytes."""
    return InputError(
        f"servers: files: {size >> 20} MiB are more than {LARGEST_BYTES >> 20}; copy them to the servers' "
        "machines and name their folder with the option code"
    )


def read_named(path: Path) -> bytes:
    """Return what a file holds. Raises InputError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"servers: files: {path}: cannot be read: {error.strerror}") from error


def _lies_inside(pattern: str) -> bool:
    path = Path(pattern)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts


def _is_in(home: Path, path: Path) -> bool:
    return path.resolve().is_relative_to(home.resolve())


def _safe_matches(home: Path, pattern: str) -> list[Path]:
    """Return what a pattern of a run folder names, which may be anybody's: nothing outside of the folder."""
    if not _lies_inside(pattern):
        return []
    with suppress(ValueError, NotImplementedError):
        return [path for path in _matches(home, pattern) if _is_in(home, path)]
    return []


def _matches(home: Path, pattern: str) -> list[Path]:
    """Return the files that a pattern names. Raises ValueError and NotImplementedError as `Path.glob` does.

    Below a run folder, a hidden one and __pycache__ it names none, unless it names that folder without a
    wildcard: runs lie beside their simulation, and no run could go on once it has written its own files.
    """
    named = len(_folders_named(pattern))
    passed: dict[Path, bool] = {home: True}

    def is_passed(folder: Path) -> bool:
        if folder not in passed:
            own = len(folder.relative_to(home).parts) <= named or not _is_left_out(folder)
            passed[folder] = own and is_passed(folder.parent)
        return passed[folder]

    return [path for path in home.glob(pattern) if is_passed(path.parent) and path.is_file()]


def _folders_named(pattern: str) -> tuple[str, ...]:
    """Return the folders that a pattern begins with, up to its first wildcard."""
    folders = Path(pattern).parts[:-1]
    return tuple(itertools.takewhile(lambda name: not set("*?[") & set(name), folders))


def _is_left_out(folder: Path) -> bool:
    if folder.name.startswith(".") or folder.name == "__pycache__":
        return True
    return any((folder / name).exists() for name in _OF_A_RUN)


def _left_out(pattern: str) -> str:
    """Return, for an error, where a pattern finds nothing."""
    if len(_folders_named(pattern)) == len(Path(pattern).parts) - 1:
        return ""
    return ", apart from folders that a wildcard leaves out: of runs, hidden ones and __pycache__"
