"""The source of one component of an experiment as it is now."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.common.modules import label_of
from swarmwright.common.simulation_names import SimulationName
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
    found = (of_plug_in(*one) for one in names)
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
