"""Gymnasium's spaces as sensors and actuators.

Sensors: numbers with bounds are scaled to -1..1, others stay as they are; a choice of n is n numbers, 1 for
what is chosen and 0 for the rest; dictionaries and tuples follow one part after the other.

Actuators, -1..1: numbers with bounds are scaled to these, others stay as they are; of two choices the sign
decides, of more the largest of as many actuators, the first one among equals.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarmwright.core.errors import InputError

Numbers = NDArray[np.float64]

_UNBOUNDED = 1e6
"""Bounds from here on are none: some environments write a large number for infinity."""


class Sensors(NamedTuple):
    """How an observation becomes numbers."""

    width: int
    read: Callable[[Any], Numbers]
    """Observation -> (width,)"""


class Actuators(NamedTuple):
    """How numbers become an action."""

    width: int
    act: Callable[[Numbers], Any]
    """(width,), -1 to 1 -> action"""


def sensors(space: Any, where: str) -> Sensors:  # noqa: ANN401 - whatever an environment says
    """Return the sensors for an observation space. Raises InputError for one whose size changes."""
    match space:
        case spaces.Box():
            middle, half = _range(space)
            return Sensors(half.size, lambda seen: (np.asarray(seen, float).ravel() - middle) / half)
        case spaces.Discrete():
            count, start = int(space.n), int(space.start)
            return Sensors(count, lambda seen: np.eye(count)[int(seen) - start])
        case spaces.MultiBinary():
            return Sensors(int(np.prod(space.shape)), lambda seen: np.asarray(seen, float).ravel())
        case spaces.MultiDiscrete():
            counts, starts = space.nvec.ravel(), space.start.ravel()
            ends = np.cumsum(counts)

            def chosen(seen: Any) -> Numbers:  # noqa: ANN401 - an array of choices
                row = np.zeros(ends[-1])
                row[ends - counts + np.ravel(seen) - starts] = 1
                return row

            return Sensors(int(ends[-1]), chosen)
        case spaces.Dict():
            inner: list[tuple[Any, Any]] = list(space.spaces.items())
        case spaces.Tuple():
            inner = list(enumerate(space.spaces))
        case _:
            raise InputError(
                f"{where}: a {type(space).__name__} space cannot be read by sensors, whose number is fixed; "
                "wrap the environment so that it gives a Box"
            )
    parts = [(key, sensors(part, f"{where}[{key!r}]")) for key, part in inner]
    width = sum(part.width for _, part in parts)
    return Sensors(width, lambda seen: np.concatenate([part.read(seen[key]) for key, part in parts]))


def actuators(space: Any, where: str) -> Actuators:  # noqa: ANN401 - whatever an environment says
    """Return the actuators for an action space. Raises InputError for one that cannot be steered."""
    match space:
        case spaces.Box():
            middle, half = _range(space)
            shape, kind = space.shape, space.dtype

            def scaled(row: Numbers) -> Any:  # noqa: ANN401 - of the space's type
                action = (middle + half * row).reshape(shape).astype(kind)
                return np.clip(action, space.low, space.high)

            return Actuators(half.size, scaled)
        case spaces.Discrete():
            width, choose = _choice(int(space.n))
            start = int(space.start)
            return Actuators(width, lambda row: start + choose(row))
        case spaces.MultiDiscrete():
            choices = [_choice(int(count)) for count in space.nvec.ravel()]
            ends = np.cumsum([width for width, _ in choices])
            firsts, starts = space.start, space.nvec.shape

            def several(row: Numbers) -> Any:  # noqa: ANN401 - of the space's type
                parts = np.split(row, ends[:-1])
                picked = [choose(part) for (_, choose), part in zip(choices, parts, strict=True)]
                return (firsts + np.reshape(picked, starts)).astype(space.dtype)

            return Actuators(int(ends[-1]), several)
        case spaces.MultiBinary():
            shape = space.shape
            return Actuators(int(np.prod(shape)), lambda row: (row > 0).astype(np.int8).reshape(shape))
    raise InputError(
        f"{where}: a {type(space).__name__} space cannot be steered by actuators; "
        "wrap the environment so that it takes a Box or a Discrete"
    )


def _range(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle of each number's range and half its width, flat; 0 and 1 where it has no bounds."""
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    bounded = (low > -_UNBOUNDED) & (high < _UNBOUNDED) & (low < high)
    low, high = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return (low + high) / 2, (high - low) / 2


def _choice(count: int) -> tuple[int, Callable[[Numbers], int]]:
    """Return how many actuators choose one of `count`, and how."""
    if count <= 2:
        return 1, lambda row: int(row[0] > 0 and count == 2)
    return count, lambda row: int(row.argmax())
