"""Values that variables of FMUs can have by their types: whole numbers within limits, booleans, text."""

import math
from collections.abc import Mapping
from typing import Any

from swarmwright.simulations.fmu.description import Variable

_SEEDS = 2**31
_WIDTHS = {"Int8": 8, "Int16": 16, "Int32": 32, "Int64": 64, "Integer": 32, "Enumeration": 32}
_SIGNED = {kind: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for kind, bits in _WIDTHS.items()}
_UNSIGNED = {f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)}
_LIMITS: Mapping[str, tuple[int, int]] = {**_SIGNED, **_UNSIGNED}
_MOST_ITEMS = 20
"""Items of an enumeration that a message names."""


def limits(variable: Variable) -> tuple[int, int] | None:
    """Return the lowest and the highest value of an integer or enumeration; None for other types."""
    if variable.items:
        return min(variable.items), max(variable.items)
    return _LIMITS.get(variable.type)


def is_unsigned(variable: Variable) -> bool:
    """Whether it is an integer that cannot be negative."""
    return variable.type in _UNSIGNED


def expected(variable: Variable) -> str | None:
    """Return in words what one value can be; None where there is none that can be given."""
    bounds = limits(variable)
    if variable.items:
        items = [str(one) for one in sorted(variable.items)]
        return f"one of {', '.join(items[:_MOST_ITEMS])}{', ..' if len(items) > _MOST_ITEMS else ''}"
    if bounds is not None:
        return f"an integer from {bounds[0]} to {bounds[1]}"
    return {"Boolean": "true or false", "String": "a string"}.get(
        variable.type, "a number" if variable.is_real else None
    )


def fits(variable: Variable, value: Any) -> bool:  # noqa: ANN401 - any value of a file
    """Whether one value is of a variable's type, within the limits of its type; 0 and 1 are booleans, too."""
    if variable.type == "String":
        return isinstance(value, str)
    if variable.type == "Boolean":
        return isinstance(value, bool) or (isinstance(value, int) and value in (0, 1))
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    if variable.is_real:
        return _is_finite(value)
    bounds = limits(variable)
    if bounds is None or value != value // 1:  # neither NaN nor an infinity is equal to what is left of it
        return False
    return value in variable.items if variable.items else bounds[0] <= value <= bounds[1]


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond binary64
        return False


def native(variable: Variable, value: Any) -> Any:  # noqa: ANN401 - a number, boolean or text
    """Return a value as FMPy sets it: integers rounded, and clipped to their limits, beyond which C wraps."""
    if variable.type == "Boolean":
        return bool(value)
    bounds = limits(variable)
    return value if bounds is None else round(min(max(value, bounds[0]), bounds[1]))


def driven(variable: Variable, share: float, value: float) -> float:
    """Return what an actuator sets.

    share: the actuator, -1 to 1. value: the same in the range and the unit of the variable. A boolean is true
    above the middle, and an enumeration has the nearest of its items.
    """
    if variable.type == "Boolean":
        return float(share > 0.0)
    if variable.items:
        return min(variable.items, key=lambda item: abs(item - value))
    return value


def seed_of(variable: Variable, seed: int) -> int:
    """Return an episode's seed for a variable: modulo 2^31, or as many numbers from 0 as its type has."""
    if variable.type == "UInt64":
        return seed
    bounds = limits(variable)
    return seed % (_SEEDS if bounds is None else min(_SEEDS, bounds[1] + 1))


def takes_seeds(variable: Variable) -> bool:
    """Whether a variable can get the seed of an episode: one number, and not one of few items."""
    return variable.is_number and variable.type not in ("Boolean", "Enumeration")
