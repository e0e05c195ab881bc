"""Components by name: built-in ones, and those that other packages announce as entry points."""

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
    """The components of one sort (representations, methods, rankings), imported on demand.

    Args:
        noun: name of the sort, for messages.
        group: group of entry points for other packages, as `kind = "package.module:Class"`.
        built_in: kind -> "module:Class".
        base: required base class, as "module:Class".
        in_files: whether a kind may also be `path/to/file.py:Class`.

    """

    def __init__(
        self, noun: str, group: str, built_in: Mapping[str, str], base: str, *, in_files: bool = False
    ) -> None:
        self.noun = noun
        self.group = group
        self.built_in = dict(built_in)
        self._base = base
        self.in_files = in_files
        self._loaded: dict[str, type[Component]] = {}
        self._stand_in: ContextVar[type[Component] | None] = ContextVar(f"stand_in {noun}", default=None)
        self._unread: ContextVar[type[Component] | None] = ContextVar(f"unread {noun}", default=None)

    @cached_property
    def _entry_points(self) -> dict[str, list[EntryPoint]]:
        return find_entry_points(self.group)

    def names(self) -> list[str]:
        """Return all kinds, sorted."""
        return sorted({*self.built_in, *self._entry_points})

    def get(self, kind: str) -> type[Component]:
        """Return the class of a component.

        Raises InputError if the kind is unknown, announced by two packages, or cannot be imported.
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
        """Raise the errors of `get` for a kind, prefixed with the option that names it; accept None."""
        if kind is None:
            return
        try:
            self.get(kind)
        except InputError as error:
            raise InputError(f"{option}: {error}") from None

    def is_in_file(self, kind: str) -> bool:
        """Return whether a kind is a class in a file: `path/to/file.py:Class`."""
        return self.in_files and SimulationName.parse(kind).file is not None

    @contextmanager
    def unread(self, stand_in: type[Component]) -> Iterator[None]:
        """Let `get` return `stand_in` for classes in files within the block, without importing them."""
        token = self._unread.set(stand_in)
        try:
            yield
        finally:
            self._unread.reset(token)

    @contextmanager
    def lenient(self, stand_in: type[Component]) -> Iterator[None]:
        """Let `get` return `stand_in` for unavailable components within the block.

        For data that were created elsewhere with a component, and can be read without it.
        """
        token = self._stand_in.set(stand_in)
        try:
            yield
        finally:
            self._stand_in.reset(token)

    def module(self, kind: str) -> str | None:
        """Return the module of a plug-in, None for a built-in kind. Raises the errors of `get`."""
        return None if kind in self.built_in else self._point(kind).module

    def _load(self, kind: str) -> type[Component]:
        if kind in self.built_in:
            # A built-in name cannot be taken over: an experiment file must mean the same everywhere.
            return _resolve(self.built_in[kind])
        point = self._point(kind)
        component = load_plug_in(self.noun, point)
        base: type[Component] = _resolve(self._base)
        if not (isinstance(component, type) and issubclass(component, base)):
            raise InputError(
                f"{describe_plug_in(self.noun, point)} is not a subclass of {self._base.replace(':', '.')}"
            )
        if not _has_options(base):  # modules, which are checked on use
            return component
        missing = _missing(component)
        if missing:
            raise InputError(f"{describe_plug_in(self.noun, point)}: lacks {', '.join(missing)}")
        return component

    def _from_file(self, kind: str) -> type[Component]:
        """Import a class from a file, again if it was edited, and set the kind of its options.

        Raises InputError, with file and line, if it is not a component.
        """
        parsed = SimulationName.parse(kind)
        assert parsed.file is not None
        # By name, because code that imports users' files is in a higher layer.
        code, _ = import_module("swarmwright.simulations.loading").import_with_digest(parsed.file)
        base: type[Component] = _resolve(self._base)
        member = getattr(code, parsed.member, None)
        file = shorten_path(str(parsed.file))
        if member is None:
            classes = [
                name
                for name, value in vars(code).items()
                if isinstance(value, type) and issubclass(value, base) and value.__module__ == code.__name__
            ]
            choices = f"available: {', '.join(classes)}" if classes else f"it has no {self.noun}"
            hint = did_you_mean(parsed.member, classes) or ";"
            raise InputError(f"{file}: has no class {parsed.member!r}{hint} {choices}")
        if not (isinstance(member, type) and issubclass(member, base)):
            location = locate_definition(member) if hasattr(member, "__qualname__") else file
            raise InputError(
                f"{location}: {parsed.member} is not a subclass of {self._base.replace(':', '.')}, which "
                "every "
                f"{self.noun} is"
            )
        if not hasattr(member, "options_model"):
            of_class: Any = member
            of_class.options_model = of_class.default_options
        missing = _missing(member)
        if missing:
            raise InputError(f"{locate_definition(member)}: {parsed.member} lacks {', '.join(missing)}")
        return _with_kind(member, kind)

    def _point(self, kind: str) -> EntryPoint:
        points = self._entry_points.get(kind)
        if points is None:
            raise InputError(unknown(self.noun, kind, self.names()))
        return choose_entry_point(self.noun, points)


def _missing(component: type) -> list[str]:
    """Return the required members that a component lacks."""
    missing = sorted(getattr(component, "__abstractmethods__", ()))
    if not isinstance(getattr(component, "options_model", Options), type):
        missing.append("options_model, a class of options")
    elif not hasattr(component, "options_model"):
        missing.append("options_model")
    return missing


def _with_kind(component: type[Component], kind: str) -> type[Component]:
    """Set the kind of a class's options to its name in the experiment; return the class."""
    of_class: Any = component
    if not hasattr(of_class, "kind"):
        of_class.kind = component.__name__
    model = of_class.options_model
    if model.model_fields["kind"].default != kind or model.model_fields["kind"].annotation is not str:
        renamed = create_model(model.__name__, __base__=model, __module__=model.__module__, kind=(str, kind))
        renamed.__doc__ = model.__doc__
        of_class.options_model = renamed
    return component


def _has_options(base: type) -> bool:
    """Return whether components of a sort have typed options."""
    return any("options_model" in vars(base_class).get("__annotations__", {}) for base_class in base.__mro__)


def _resolve(address: str) -> type:
    module, _, name = address.partition(":")
    component: type = getattr(import_module(module), name)
    return component
