"""Components by name: built in ones, and those that other packages announce as entry points."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint
from typing import Any, Generic, TypeVar

from pydantic import create_model

from swarmwright.common.entry_points import (
    choose_entry_point,
    describe_plug_in,
    find_entry_points,
    load_plug_in,
)
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean, unknown
from swarmwright.common.tracebacks import locate_definition, shorten_path

Component = TypeVar("Component")


class Registry(Generic[Component]):
    """The components of one sort (representations, methods, rankings), imported when they are asked for.

    Args:
        what: the sort in words, for messages.
        group: entry point group in which other packages announce theirs, as `kind = "package.module:Class"`.
        built_in: kind -> "module:Class", one line each.
        base: class that every component must derive from, as "module:Class".
        in_files: whether a kind may also be `path/to/file.py:Class`.

    """

    def __init__(
        self, what: str, group: str, built_in: Mapping[str, str], base: str, *, in_files: bool = False
    ) -> None:
        self.what = what
        self.group = group
        self.built_in = dict(built_in)
        self._base = base
        self.in_files = in_files
        self._loaded: dict[str, type[Component]] = {}
        self._stand_in: ContextVar[type[Component] | None] = ContextVar(f"stand_in {what}", default=None)
        self._unread: ContextVar[type[Component] | None] = ContextVar(f"unread {what}", default=None)

    @cached_property
    def _entry_points(self) -> dict[str, list[EntryPoint]]:
        return find_entry_points(self.group)

    def names(self) -> list[str]:
        """Return all kinds there are, sorted."""
        return sorted({*self.built_in, *self._entry_points})

    def get(self, kind: str) -> type[Component]:
        """Return the component's class.

        Raises InputError for an unknown kind, one that two packages claim, or one that cannot be imported.
        """
        if self.is_in_file(kind):
            return self._unread.get() or self._from_file(kind)
        if kind not in self._loaded:
            try:
                self._loaded[kind] = self._load(kind)
            except InputError:
                stand_in = self._stand_in.get()
                if stand_in is None:
                    raise
                return stand_in
        return self._loaded[kind]

    def check(self, option: str, kind: str | None) -> None:
        """Raise InputError that begins with the option which names a kind, as `get`; None names none."""
        if kind is None:
            return
        try:
            self.get(kind)
        except InputError as error:
            raise InputError(f"{option}: {error}") from None

    def is_in_file(self, kind: str) -> bool:
        """Whether a kind names a class by its file: `path/to/file.py:Class`."""
        return self.in_files and SimulationName.parse(kind).file is not None

    @contextmanager
    def unread(self, stand_in: type[Component]) -> Iterator[None]:
        """Within the block, `get` returns `stand_in` in the place of classes in files and imports none."""
        token = self._unread.set(stand_in)
        try:
            yield
        finally:
            self._unread.reset(token)

    @contextmanager
    def lenient(self, stand_in: type[Component]) -> Iterator[None]:
        """Within the block, `get` returns `stand_in` in the place of a component that is not to be had here.

        For what was made with it elsewhere, and can be read without.
        """
        token = self._stand_in.set(stand_in)
        try:
            yield
        finally:
            self._stand_in.reset(token)

    def module(self, kind: str) -> str | None:
        """Return the module that holds a plug-in, None for what is built in. Raises InputError as `get`."""
        return None if kind in self.built_in else self._point(kind).module

    def _load(self, kind: str) -> type[Component]:
        if kind in self.built_in:
            # A built-in name cannot be taken over: an experiment file must mean the same everywhere.
            return _resolve(self.built_in[kind])
        point = self._point(kind)
        component = load_plug_in(self.what, point)
        base: type[Component] = _resolve(self._base)
        if not (isinstance(component, type) and issubclass(component, base)):
            raise InputError(
                f"{describe_plug_in(self.what, point)} is not a subclass of {self._base.replace(':', '.')}"
            )
        if not _has_options(base):  # modules, which are checked where they are used
            return component
        missing = _missing(component)
        if missing:
            raise InputError(f"{describe_plug_in(self.what, point)}: lacks {', '.join(missing)}")
        return component

    def _from_file(self, kind: str) -> type[Component]:
        """Import a class by its file, anew where that was edited; give it options that have this kind.

        Raises InputError, with file and line, for what is not a component.
        """
        parsed = SimulationName.parse(kind)
        assert parsed.file is not None
        # By name, as plug-ins are: what imports the code of users is above this package.
        code, _ = import_module("swarmwright.simulations.loading").import_with_digest(parsed.file)
        base: type[Component] = _resolve(self._base)
        found = getattr(code, parsed.member, None)
        file = shorten_path(str(parsed.file))
        if found is None:
            classes = [
                name
                for name, value in vars(code).items()
                if isinstance(value, type) and issubclass(value, base) and value.__module__ == code.__name__
            ]
            there = f"available: {', '.join(classes)}" if classes else f"it has no {self.what}"
            hint = did_you_mean(parsed.member, classes) or ";"
            raise InputError(f"{file}: has no class {parsed.member!r}{hint} {there}")
        if not (isinstance(found, type) and issubclass(found, base)):
            place = locate_definition(found) if hasattr(found, "__qualname__") else file
            raise InputError(
                f"{place}: {parsed.member} is not a subclass of {self._base.replace(':', '.')}, which every "
                f"{self.what} is"
            )
        if not hasattr(found, "options_model"):
            of_class: Any = found
            of_class.options_model = of_class.default_options
        missing = _missing(found)
        if missing:
            raise InputError(f"{locate_definition(found)}: {parsed.member} lacks {', '.join(missing)}")
        return _with_kind(found, kind)

    def _point(self, kind: str) -> EntryPoint:
        points = self._entry_points.get(kind)
        if points is None:
            raise InputError(unknown(self.what, kind, self.names()))
        return choose_entry_point(self.what, points)


def _missing(component: type) -> list[str]:
    """Return what a component has to have, and lacks."""
    missing = sorted(getattr(component, "__abstractmethods__", ()))
    if not isinstance(getattr(component, "options_model", Options), type):
        missing.append("options_model, a class of options")
    elif not hasattr(component, "options_model"):
        missing.append("options_model")
    return missing


def _with_kind(component: type[Component], kind: str) -> type[Component]:
    """Return a class of a file; its options have the kind by which the experiment names it."""
    of_class: Any = component
    if not hasattr(of_class, "kind"):
        of_class.kind = component.__name__
    model = of_class.options_model
    if model.model_fields["kind"].default != kind or model.model_fields["kind"].annotation is not str:
        made = create_model(model.__name__, __base__=model, __module__=model.__module__, kind=(str, kind))
        made.__doc__ = model.__doc__
        of_class.options_model = made
    return component


def _has_options(base: type) -> bool:
    """Whether components of a sort have typed options."""
    return any("options_model" in vars(base_class).get("__annotations__", {}) for base_class in base.__mro__)


def _resolve(address: str) -> type:
    module, _, name = address.partition(":")
    component: type = getattr(import_module(module), name)
    return component
