"""Behaviours and conditions by their names: the engine's, those of installed packages, and those in files."""

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
"""Of the range of a parameter, without its sign."""
_TAKEN = {"name", "behaviour", "transitions", "to", "condition"}
"""Keys of machines in files."""
_MOST_STATE = 1000
"""Numbers of a module's state for each robot."""

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
"""What, class, SHA-256 -> what was imported from files, and from which."""


def module(what: str, name: str) -> grammar.Module:
    """Return what is known of a behaviour or a condition.

    Args:
        what: behaviour or condition.
        name: a registered one, or `path/to/file.py:Class`, whose file is imported.

    Raises InputError for an unknown one, and one that is not right.
    """
    return _from_file(what, name) if is_in_file(name) else _by_name(what, name)


@overload
def implementation(what: Literal["behaviour"], known: grammar.Module) -> type[Behaviour]: ...


@overload
def implementation(what: Literal["condition"], known: grammar.Module) -> type[Condition]: ...


def implementation(what: str, known: grammar.Module) -> Kind:
    """Return the class of a behaviour or a condition of a specification.

    Raises InputError where it is not installed, its file was not imported, or it has other parameters.
    """
    if known.file:
        kind, there, _ = _found(what, known)
    else:
        there, kind = _by_name(what, known.name), REGISTRIES[what].get(known.name)
    if there != known:
        raise InputError(
            f"{what} {known.name!r}: has other parameters, or other ranges of these, than when this "
            "controller was designed; use the version of that time"
        )
    return kind


def _found(what: str, known: grammar.Module) -> tuple[Kind, grammar.Module, Path]:
    """Return what was imported of a module in a file. Raises InputError where it was not."""
    found = _in_files.get((what, known.name, known.sha256))
    if found is None:
        raise InputError(
            f"{what} {known.name!r}: its code, {known.file} (SHA-256 {known.sha256[:16]}..), is not "
            "known here; load the controller from its run folder, or from a file beside that code "
            "(Controller.load)"
        )
    return found


def name_of(what: str, known: grammar.Module) -> str:
    """Return the name by which a module of a specification is imported: that of `module`.

    Raises InputError where its file was not imported.
    """
    return f"{_found(what, known)[2]}:{known.name}" if known.file else known.name


def find(specification: Mapping[str, Any], folder: Path) -> None:
    """Import the code of modules that a controller in a folder names by their files.

    It lies beside the controller, or in the folder's copies where that is a run's; only code with the SHA-256
    that the controller knows is imported. Raises InputError for code that is not trusted.
    """
    catalogue = grammar.Catalogue.of(specification)
    for what, parts in (("behaviour", catalogue.behaviours), ("condition", catalogue.conditions)):
        for part in parts:
            if part.file and (what, part.name, part.sha256) not in _in_files:
                path = _loading().find_file(folder, part.file, part.sha256)
                if path is not None:
                    _from_file(what, f"{path}:{part.name}")


def _loading() -> Any:  # noqa: ANN401 - a module
    # By name, as plug-ins are: what imports the code of users is above this package.
    return import_module("swarmwright.simulations.loading")


def _from_file(what: str, name: str) -> grammar.Module:
    parsed = SimulationName.parse(name)
    assert parsed.file is not None
    code, sha256 = _loading().import_with_digest(parsed.file)
    found = getattr(code, parsed.member, None)
    base = Behaviour if what == "behaviour" else Condition
    if not (isinstance(found, type) and issubclass(found, base)):
        file = shorten_path(str(parsed.file))
        if found is not None:
            raise InputError(
                f"{file}: {parsed.member} is not a subclass of "
                f"swarmwright.controllers.modules.{base.__name__}"
            )
        classes = [
            key
            for key, value in vars(code).items()
            if isinstance(value, type) and issubclass(value, base) and value is not base
        ]
        there = f"available: {', '.join(classes)}" if classes else f"no {what} is there"
        raise InputError(
            f"{file}: has no class {parsed.member!r}{did_you_mean(parsed.member, classes) or ';'} {there}"
        )
    label = parsed.member
    made = grammar.Module(label, _ranges(what, label, found), parsed.file.name, sha256)
    _in_files[what, label, sha256] = (found, made, parsed.file.absolute())
    return made


@cache
def _by_name(what: str, name: str) -> grammar.Module:
    registry = REGISTRIES[what]
    if name in registry.built_in:
        return grammar.built_in(name)
    return grammar.Module(name, _ranges(what, name, registry.get(name)))


def _ranges(what: str, name: str, found: Kind) -> dict[str, grammar.Range]:
    """Return the parameters of a module. Raises InputError for what is not right with it."""
    where = f"{locate_definition(found)}: {what} {name!r} ({found.__name__})"
    if inspect.isabstract(found):
        missing = ", ".join(sorted(found.__abstractmethods__))
        raise InputError(f"{where}: defines no {missing}()")
    if not isinstance(found.parameters, Mapping):
        raise InputError(f"{where}: parameters must be a mapping from names to Parameter(low, high)")
    state: object = found.state
    if not isinstance(state, int) or isinstance(state, bool) or not 0 <= state <= _MOST_STATE:
        raise InputError(f"{where}: state must be an integer of 0 to {_MOST_STATE}, not {state!r}")
    return {key: _range(where, key, parameter) for key, parameter in found.parameters.items()}


def _range(where: str, name: object, given: object) -> grammar.Range:
    where = f"{where}: parameter {name!r}"
    if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN:
        raise InputError(f"{where}: must be named by an identifier, none of {', '.join(sorted(_TAKEN))}")
    if not isinstance(given, Parameter):
        raise InputError(
            f"{where}: is {given!r}, expected Parameter(low, high) or Parameter(low, high, True)"
        )
    for limit in (given.low, given.high):
        if not _is_number(limit):
            raise InputError(
                f"{where}: {limit!r} is not a number of -{_LARGEST_LIMIT:g} to {_LARGEST_LIMIT:g}"
            )
        if given.integer and limit != int(limit):
            raise InputError(f"{where}: {limit!r} is not an integer, but integer is True")
    if given.integer:
        low, high = float(int(given.low)), float(int(given.high))
    else:
        low, high = float(np.float32(given.low)), float(np.float32(given.high))
    if not low < high:
        raise InputError(f"{where}: low, {given.low:g}, must be smaller than high, {given.high:g}")
    return low, high, bool(given.integer)


def _is_number(limit: object) -> bool:
    """Whether it is a number that a parameter may have."""
    if not isinstance(limit, int | float) or isinstance(limit, bool):
        return False
    return math.isfinite(limit) and abs(limit) <= _LARGEST_LIMIT
