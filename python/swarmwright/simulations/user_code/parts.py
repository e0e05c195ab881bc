"""The current source of a component of an experiment, and data files.

Data files are read by a simulation and named by an experiment, `servers: {files: [maps/*.json]}`.
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
"""Kinds of modules in a `controller` of the kind `modules` that may be plug-ins."""
_SEPARATOR = "-"


@dataclass(frozen=True)
class Source:
    """A source file."""

    origin: Path
    data: bytes

    @property
    def digest(self) -> str:
        """SHA-256, in hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True)
class Part:
    """The source of a component."""

    name: str
    """simulation, controller, method or ranking; behaviour-NAME, condition-NAME"""
    component: str
    """Its name in the experiment: the class or environment, or the kind of a plug-in."""
    main: str
    """The file that defines it, a key of `files`."""
    module: str | None
    """Its import name; None for a file that is loaded by its path."""
    files: Mapping[str, Source]
    """Files by location: their path below the import folder."""
    packages: frozenset[str]
    """Import names of the installed packages that it imports."""
    data: frozenset[str] = frozenset()
    """Locations of the data files, which it reads and does not import."""
    patterns: tuple[str, ...] = ()
    """The experiment's patterns for the data files."""

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file by its location."""
        return {location: source.digest for location, source in self.files.items()}

    @property
    def in_file(self) -> bool:
        """Whether the experiment names it by its file."""
        return SimulationName.parse(self.component).file is not None

    @property
    def origin(self) -> Path:
        """The main file."""
        return self.files[self.main].origin

    @classmethod
    def from_file(cls, name: str, component: str, path: Path) -> Self:
        """Read a file and those that it imports. Raises InputError."""
        return cls._read(name, component, path.name, None, lambda: Walk.from_file(path.resolve()))

    @classmethod
    def from_module(cls, name: str, component: str, module: str, *, installed: bool = True) -> Self | None:
        """Read the source of a module; return None if there is none. Raises InputError."""
        part = cls._read(name, component, "", module, lambda: Walk.from_module(module, installed=installed))
        path = module.replace(".", "/")
        for main in (f"{path}.py", f"{path}/__init__.py"):
            if main in part.files:
                return cls(name, component, main, module, part.files, part.packages)
        return None

    @classmethod
    def from_command(cls, name: str) -> Self:
        """Read the files of a command and its definition. Raises InputError."""
        from swarmwright.simulations.command.checking import parse_name  # noqa: PLC0415 - pydantic, only for commands
        from swarmwright.simulations.user_code import command_sources  # noqa: PLC0415 - as above

        options = parse_name(name)
        main, sources = command_sources.sources_of(options)
        origin = Path(options.folder).resolve() / SimulationName.DEFINITION
        files = {main: Source(origin, command_sources.definition_of(options))}
        for location, path in sources.items():
            try:
                files[location] = Source(path, path.read_bytes())
            except OSError as error:
                raise InputError(f"{path}: cannot be read: {error.strerror}") from error
        component = SimulationName.parse(name).with_file(SimulationName.DEFINITION)
        return cls("simulation", component, main, None, files, frozenset())

    @classmethod
    def _read(cls, name: str, component: str, main: str, module: str | None, walk: Any) -> Self:  # noqa: ANN401 - a function
        try:
            walked = walk()
            files = {
                location: Source(path, path.read_bytes()) for location, path in sorted(walked.files.items())
            }
        except OSError as error:
            raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error
        return cls(name, component, main, module, files, frozenset(walked.packages))


def read_simulation(name: str) -> Part | None:
    """Return the source of a simulation; None for built-in ones and classes of a notebook.

    Raises InputError if a file cannot be read.
    """
    parsed = SimulationName.parse(name)
    module = parsed.module
    if parsed.is_command:
        return Part.from_command(name)
    if parsed.is_environment:
        return Part.from_module("simulation", name, module, installed=False) if _importable(module) else None
    if parsed.file is not None:
        return Part.from_file("simulation", parsed.with_file(parsed.file.name), parsed.file)
    if module.partition(".")[0] in {"__main__", "swarmwright"} or not module:
        return None
    return Part.from_module("simulation", name, module)


def _importable(module: str) -> bool:
    return bool(module) and all(part.isidentifier() for part in module.split("."))


def is_plug_in(name: str) -> bool:
    """Return whether a part is a plug-in: of a section of the experiment, or of a module of `modules`."""
    return name in SECTIONS or name.partition(_SEPARATOR)[0] in MODULES


def read_plug_in(section: str, kind: str) -> Part | None:
    """Return the source of a plug-in; None if it is built in. Raises InputError like the registry."""
    kind_of_module = section.partition(_SEPARATOR)[0]
    parsed = SimulationName.parse(kind)
    if parsed.file is not None:
        return Part.from_file(section, parsed.with_file(parsed.file.name), parsed.file)
    if kind_of_module in MODULES:
        from swarmwright.controllers.modules.registered import REGISTRIES as OF_MODULES  # noqa: PLC0415 - NumPy, not for --help

        module = OF_MODULES[kind_of_module].module(kind)
        return None if module is None else Part.from_module(section, kind, module)
    from swarmwright.methods.plug_ins import REGISTRIES  # noqa: PLC0415 - NumPy, not for --help

    module = REGISTRIES[section].module(kind)
    return None if module is None else Part.from_module(section, kind, module)


def format_part_name(kind: str, name: str) -> str:
    """Return the name of the part for a module with this name in an experiment."""
    return f"{kind}{_SEPARATOR}{label_of(name)}"


def read_plug_ins(experiment: Any) -> list[Part]:  # noqa: ANN401 - an Experiment, which is above this
    """Return the sources of all plug-ins that an experiment uses."""
    sections = ((section, getattr(experiment, section)) for section in SECTIONS)
    # Plug-ins that are not installed have no source, and need none if the run is only read.
    names = [
        (name, options.kind)
        for name, options in sections
        if not getattr(options, "unavailable", False) or SimulationName.parse(options.kind).file is not None
    ]
    for kind, name in getattr(experiment.controller, "plug_ins", ()):
        names.append((format_part_name(kind, name), name))
    parts = (read_plug_in(*part_name) for part_name in names)
    return [part for part in parts if part is not None]


def distributions(parts: Iterable[Part]) -> tuple[str, ...]:
    """Return the distribution names of the installed packages that parts import."""
    names = sorted({name for part in parts for name in part.packages})
    distributions_by_package: Mapping[str, list[str]] | None = None
    distribution_names = []
    for name in names:
        try:
            version(name)
        except PackageNotFoundError:
            if distributions_by_package is None:
                distributions_by_package = (
                    packages_distributions()
                )  # reads the lists of all files of all packages
            distribution_names += sorted(set(distributions_by_package.get(name, ())))
        else:
            distribution_names.append(name)
    return tuple(dict.fromkeys(distribution_names))


LARGEST_BYTES = 1 << 28
"""Largest size of all data files of a simulation in bytes."""
_OF_A_RUN = ("run.sqlite", "run.sqlite.new")
"""Files that identify a run folder."""


def get_home(part: Part) -> Path:
    """Return the folder that patterns are relative to: the import folder of the part's modules."""
    return part.origin.parents[len(Path(part.main).parts) - 1]


def find_named_files(home: Path, patterns: Sequence[str]) -> list[Path]:
    """Return the files that match patterns.

    Raises InputError for a pattern without matches or outside the folder.
    """
    files: set[Path] = set()
    for pattern in patterns:
        if not _lies_inside(pattern):
            raise InputError(f"servers: files: {pattern!r} must lie in {home}, beside the simulation")
        try:
            matches = _matches(home, pattern)
        except (ValueError, NotImplementedError) as error:
            raise InputError(
                f"servers: files: {pattern!r} is not a valid pattern: {error}; write a path, with * for any "
                "name and **/ for any folders"
            ) from None
        if not matches:
            raise InputError(
                f"servers: files: there is no file {pattern} in {home}, the import folder of the "
                f"simulation's code{_explain_exclusion(pattern)}"
            )
        outside = next((path for path in matches if not _is_in(home, path)), None)
        if outside is not None:
            raise InputError(
                f"servers: files: {outside} is a link to {outside.resolve()}, outside {home}; put the file "
                "itself there, or exclude it from the pattern"
            )
        files.update(matches)
    return sorted(files)


def with_data(part: Part, patterns: Sequence[str]) -> Part:
    """Return a part with the files that match patterns; patterns without matches are ignored.

    Raises InputError if a file cannot be read, or the files are too large.
    """
    if not patterns:
        return part
    home = get_home(part)
    paths = {path for pattern in patterns for path in _safe_matches(home, pattern)}
    located_paths = {path.relative_to(home).as_posix(): path for path in sorted(paths)}
    located_paths = {
        location: path
        for location, path in located_paths.items()
        if location not in part.files or location in part.data
    }
    try:
        size = sum(path.stat().st_size for path in located_paths.values())
    except OSError as error:
        raise InputError(f"servers: files: {error.filename}: cannot be read: {error.strerror}") from error
    if size > LARGEST_BYTES:
        raise make_size_error(size)
    data = {location: Source(path, read_file(path)) for location, path in located_paths.items()}
    return dataclasses.replace(
        part,
        files={**part.files, **data},
        data=part.data | frozenset(data),
        patterns=tuple(dict.fromkeys([*part.patterns, *patterns])),
    )


def make_size_error(size: int) -> InputError:
    """Return the error for data files with too many bytes."""
    return InputError(
        f"servers: files: {size >> 20} MiB exceed the limit of {LARGEST_BYTES >> 20} MiB; copy the files to "
        "the servers' machines and name their folder with the option code"
    )


def read_file(path: Path) -> bytes:
    """Return the bytes of a data file. Raises InputError."""
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
    """Return the matches of an untrusted pattern of a run folder that are inside the folder."""
    if not _lies_inside(pattern):
        return []
    with suppress(ValueError, NotImplementedError):
        return [path for path in _matches(home, pattern) if _is_in(home, path)]
    return []


def _matches(home: Path, pattern: str) -> list[Path]:
    """Return the files that match a pattern. Raises ValueError and NotImplementedError like `Path.glob`.

    Run folders, hidden folders and __pycache__ are skipped unless the pattern names them without a wildcard:
    runs may lie beside their simulation, and their files would otherwise count as changes.
    """
    leading = len(_get_leading_folders(pattern))
    searched: dict[Path, bool] = {home: True}

    def is_searched(folder: Path) -> bool:
        if folder not in searched:
            is_included = len(folder.relative_to(home).parts) <= leading or not _is_excluded(folder)
            searched[folder] = is_included and is_searched(folder.parent)
        return searched[folder]

    return [path for path in home.glob(pattern) if is_searched(path.parent) and path.is_file()]


def _get_leading_folders(pattern: str) -> tuple[str, ...]:
    """Return the folders of a pattern before its first wildcard."""
    folders = Path(pattern).parts[:-1]
    return tuple(itertools.takewhile(lambda name: not set("*?[") & set(name), folders))


def _is_excluded(folder: Path) -> bool:
    if folder.name.startswith(".") or folder.name == "__pycache__":
        return True
    return any((folder / name).exists() for name in _OF_A_RUN)


def _explain_exclusion(pattern: str) -> str:
    """Return a note for an error about folders that a pattern skips; empty if it skips none."""
    if len(_get_leading_folders(pattern)) == len(Path(pattern).parts) - 1:
        return ""
    return "; wildcards skip run folders, hidden folders and __pycache__"
