"""Behaviours and conditions by their names: the engine's, and those of installed packages."""

import inspect
import math
from collections.abc import Mapping
from functools import cache

import numpy as np

from swarmwright.core import modules
from swarmwright.core.errors import InputError
from swarmwright.core.registry import Registry
from swarmwright.core.tracebacks import shown
from swarmwright.modules._base import Behaviour, Condition, Parameter

_LARGEST = 1e6
_TAKEN = {"name", "behaviour", "transitions", "to", "condition"}
"""Keys of machines in files."""
_MOST_STATE = 1000

BEHAVIOURS: Registry[Behaviour] = Registry(
    "behaviour",
    "swarmwright.behaviours",
    {
        "exploration": "swarmwright.modules._built_in:Exploration",
        "stop": "swarmwright.modules._built_in:Stop",
        "phototaxis": "swarmwright.modules._built_in:Phototaxis",
        "anti_phototaxis": "swarmwright.modules._built_in:AntiPhototaxis",
        "attraction": "swarmwright.modules._built_in:Attraction",
        "repulsion": "swarmwright.modules._built_in:Repulsion",
    },
    "swarmwright.modules:Behaviour",
)
"""All behaviours, by the names in an experiment's `controller.behaviours`."""
CONDITIONS: Registry[Condition] = Registry(
    "condition",
    "swarmwright.conditions",
    {
        "black_floor": "swarmwright.modules._built_in:BlackFloor",
        "grey_floor": "swarmwright.modules._built_in:GreyFloor",
        "white_floor": "swarmwright.modules._built_in:WhiteFloor",
        "neighbours": "swarmwright.modules._built_in:Neighbours",
        "few_neighbours": "swarmwright.modules._built_in:FewNeighbours",
        "fixed_probability": "swarmwright.modules._built_in:FixedProbability",
    },
    "swarmwright.modules:Condition",
)
"""All conditions, by the names in an experiment's `controller.conditions`."""

REGISTRIES: Mapping[str, Registry[Behaviour] | Registry[Condition]] = {
    "behaviour": BEHAVIOURS,
    "condition": CONDITIONS,
}


@cache
def module(what: str, name: str) -> modules.Module:
    """Return what is known of a behaviour or a condition.

    what: behaviour or condition. Raises InputError for an unknown one, and one that is not right.
    """
    registry = REGISTRIES[what]
    if name in registry.built_in:
        return modules.built_in(name)
    found = registry.get(name)
    where = f"{place_of(found)}: {what} {name!r} ({found.__name__})"
    if inspect.isabstract(found):
        missing = ", ".join(sorted(found.__abstractmethods__))
        raise InputError(f"{where}: defines no {missing}()")
    if not isinstance(found.parameters, Mapping):
        raise InputError(f"{where}: parameters must be a mapping from names to Parameter(low, high)")
    state: object = found.state
    if not isinstance(state, int) or isinstance(state, bool) or not 0 <= state <= _MOST_STATE:
        raise InputError(f"{where}: state must be an integer of 0 to {_MOST_STATE}, not {state!r}")
    ranges = {key: _range(where, key, one) for key, one in found.parameters.items()}
    return modules.Module(name, ranges)


def _range(where: str, name: object, given: object) -> modules.Range:
    where = f"{where}: parameter {name!r}"
    if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN:
        raise InputError(f"{where}: must be named by an identifier, none of {', '.join(sorted(_TAKEN))}")
    if not isinstance(given, Parameter):
        raise InputError(
            f"{where}: is {given!r}, expected Parameter(low, high) or Parameter(low, high, True)"
        )
    for limit in (given.low, given.high):
        if not _is_number(limit):
            raise InputError(f"{where}: {limit!r} is not a number of -{_LARGEST:g} to {_LARGEST:g}")
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
    return math.isfinite(limit) and abs(limit) <= _LARGEST


def place_of(kind: type) -> str:
    """Return the file and the line in which a class is defined."""
    try:
        return f"{shown(inspect.getsourcefile(kind) or '')}:{inspect.getsourcelines(kind)[1]}"
    except (OSError, TypeError):
        return f"{kind.__module__}.{kind.__qualname__}"
