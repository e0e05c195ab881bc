"""Lookup of behaviours and conditions: the engine's, those of installed packages, and those in files."""

import inspect
import math
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.registry import Registry
from swarmwright.common.simulation_names import SimulationName, is_in_file
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.tracebacks import locate_definition, shorten_path
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules._base import Behaviour, Condition, Parameter

_LARGEST_LIMIT = 1e6
"""Largest absolute value of a parameter's limits."""
_RESERVED_NAMES = {"name", "behaviour", "transitions", "to", "condition"}
"""Keys of machines in files."""
_MOST_STATE = 1000
"""Largest number of state values of a module for each robot."""

BEHAVIOURS: Registry[Behaviour] = Registry(
    "behaviour",
    "swarmwright.behaviours",
    {
        "exploration": "swarmwright.controllers.modules.machine:Exploration",
        "stop": "swarmwright.controllers.modules.machine:Stop",
        "phototaxis": "swarmwright.controllers.modules.machine:Phototaxis",
        "anti_phototaxis": "swarmwright.controllers.modules.machine:AntiPhototaxis",
        "attraction": "swarmwright.controllers.modules.machine:Attraction",
        "repulsion": "swarmwright.controllers.modules.machine:Repulsion",
    },
    "swarmwright.controllers.modules:Behaviour",
)
"""All behaviours, by the names in an experiment's `controller.behaviours`."""
CONDITIONS: Registry[Condition] = Registry(
    "condition",
    "swarmwright.conditions",
    {
        "black_floor": "swarmwright.controllers.modules.machine:BlackFloor",
        "grey_floor": "swarmwright.controllers.modules.machine:GreyFloor",
        "white_floor": "swarmwright.controllers.modules.machine:WhiteFloor",
        "neighbours": "swarmwright.controllers.modules.machine:Neighbours",
        "few_neighbours": "swarmwright.controllers.modules.machine:FewNeighbours",
        "fixed_probability": "swarmwright.controllers.modules.machine:FixedProbability",
    },
    "swarmwright.controllers.modules:Condition",
)
"""All conditions, by the names in an experiment's `controller.conditions`."""

REGISTRIES: Mapping[str, Registry[Behaviour] | Registry[Condition]] = {
    "behaviour": BEHAVIOURS,
    "condition": CONDITIONS,
}


Kind = type[Behaviour] | type[Condition]
_in_files: dict[tuple[str, str, str], tuple[Kind, grammar.Module, Path]] = {}
"""(role, class name, SHA-256) -> imported class, its module, and its file."""


def module(role: str, name: str) -> grammar.Module:
    """Return a behaviour or a condition by its name.

    Args:
        role: behaviour or condition.
        name: a registered name, or `path/to/file.py:Class`, whose file is imported.

    Raises InputError for an unknown or invalid module.
    """
    return _import_file(role, name) if is_in_file(name) else _find_registered(role, name)


@overload
def implementation(role: Literal["behaviour"], entry: grammar.Module) -> type[Behaviour]: ...


@overload
def implementation(role: Literal["condition"], entry: grammar.Module) -> type[Condition]: ...


def implementation(role: str, entry: grammar.Module) -> Kind:
    """Return the class of a behaviour or a condition of a specification.

    Raises InputError if it is not installed, its file was not imported, or its parameters differ.
    """
    if entry.file:
        kind, current, _ = _find_import(role, entry)
    else:
        current, kind = _find_registered(role, entry.name), REGISTRIES[role].get(entry.name)
    if current != entry:
        raise InputError(
            f"{role} {entry.name!r}: its parameters or their ranges have changed since this controller "
            "was designed; use the version of that time"
        )
    return kind


def _find_import(role: str, entry: grammar.Module) -> tuple[Kind, grammar.Module, Path]:
    """Return the import of a module in a file. Raises InputError if it was not imported."""
    imported = _in_files.get((role, entry.name, entry.sha256))
    if imported is None:
        raise InputError(
            f"{role} {entry.name!r}: its code, {entry.file} (SHA-256 {entry.sha256[:16]}..), has not been "
            "imported; load the controller with Controller.load from its run folder, or from a file beside "
            "that code"
        )
    return imported


def import_name_of(role: str, entry: grammar.Module) -> str:
    """Return the name by which a module of a specification is imported: that of `module`.

    Raises InputError if its file was not imported.
    """
    return f"{_find_import(role, entry)[2]}:{entry.name}" if entry.file else entry.name


def import_modules(specification: Mapping[str, Any], folder: Path) -> None:
    """Import the modules that a controller names by their files.

    The code is beside the controller, or in the copies of a run folder; only code with the SHA-256 in the
    controller is imported. Raises InputError for code that is not trusted.
    """
    catalogue = grammar.Catalogue.from_specification(specification)
    for role, parts in (("behaviour", catalogue.behaviours), ("condition", catalogue.conditions)):
        for part in parts:
            if part.file and (role, part.name, part.sha256) not in _in_files:
                path = _loading().find_file(folder, part.file, part.sha256)
                if path is not None:
                    _import_file(role, f"{path}:{part.name}")


def _loading() -> Any:  # noqa: ANN401 - a module
    # By name: the package that imports user code is above this one.
    return import_module("swarmwright.simulations.loading")


def _import_file(role: str, name: str) -> grammar.Module:
    parsed = SimulationName.parse(name)
    assert parsed.file is not None
    code, sha256 = _loading().import_with_digest(parsed.file)
    member = getattr(code, parsed.member, None)
    base = Behaviour if role == "behaviour" else Condition
    if not (isinstance(member, type) and issubclass(member, base)):
        file = shorten_path(str(parsed.file))
        if member is not None:
            raise InputError(
                f"{file}: {parsed.member} is not a subclass of "
                f"swarmwright.controllers.modules.{base.__name__}"
            )
        classes = [
            key
            for key, value in vars(code).items()
            if isinstance(value, type) and issubclass(value, base) and value is not base
        ]
        available = f"available: {', '.join(classes)}" if classes else f"the file defines no {role}"
        raise InputError(
            f"{file}: has no class {parsed.member!r}{did_you_mean(parsed.member, classes) or ';'} {available}"
        )
    label = parsed.member
    entry = grammar.Module(label, _ranges(role, label, member), parsed.file.name, sha256)
    _in_files[role, label, sha256] = (member, entry, parsed.file.absolute())
    return entry


@cache
def _find_registered(role: str, name: str) -> grammar.Module:
    registry = REGISTRIES[role]
    if name in registry.built_in:
        return grammar.engine_module(name)
    return grammar.Module(name, _ranges(role, name, registry.get(name)))


def _ranges(role: str, name: str, class_: Kind) -> dict[str, grammar.Range]:
    """Return the parameters of a module. Raises InputError if the class is invalid."""
    label = f"{locate_definition(class_)}: {role} {name!r} ({class_.__name__})"
    if inspect.isabstract(class_):
        missing = ", ".join(sorted(class_.__abstractmethods__))
        raise InputError(f"{label}: does not define {missing}()")
    if not isinstance(class_.parameters, Mapping):
        raise InputError(f"{label}: parameters must be a mapping from names to Parameter(low, high)")
    state: object = class_.state
    if not isinstance(state, int) or isinstance(state, bool) or not 0 <= state <= _MOST_STATE:
        raise InputError(f"{label}: state must be an integer of 0 to {_MOST_STATE}, not {state!r}")
    return {key: _range(label, key, parameter) for key, parameter in class_.parameters.items()}


def _range(label: str, name: object, parameter: object) -> grammar.Range:
    label = f"{label}: parameter {name!r}"
    if not isinstance(name, str) or not name.isidentifier() or name in _RESERVED_NAMES:
        raise InputError(
            f"{label}: the name must be an identifier other than {', '.join(sorted(_RESERVED_NAMES))}"
        )
    if not isinstance(parameter, Parameter):
        raise InputError(
            f"{label}: is {parameter!r}, expected Parameter(low, high) or Parameter(low, high, True)"
        )
    for limit in (parameter.low, parameter.high):
        if not _is_number(limit):
            raise InputError(
                f"{label}: {limit!r} is not a number of -{_LARGEST_LIMIT:g} to {_LARGEST_LIMIT:g}"
            )
        if parameter.integer and limit != int(limit):
            raise InputError(f"{label}: {limit!r} is not an integer, but integer is True")
    if parameter.integer:
        low, high = float(int(parameter.low)), float(int(parameter.high))
    else:
        low, high = float(np.float32(parameter.low)), float(np.float32(parameter.high))
    if not low < high:
        raise InputError(f"{label}: low, {parameter.low:g}, must be smaller than high, {parameter.high:g}")
    return low, high, bool(parameter.integer)


def _is_number(limit: object) -> bool:
    """Whether a limit is a number within the supported range."""
    if not isinstance(limit, int | float) or isinstance(limit, bool):
        return False
    return math.isfinite(limit) and abs(limit) <= _LARGEST_LIMIT
