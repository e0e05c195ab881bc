"""Gymnasium's spaces as sensors and actuators.

Sensors: numbers with bounds are scaled to -1..1, others stay as they are; a choice of n is n numbers, 1 for
what is chosen and 0 for the rest; dictionaries and tuples follow one part after the other.

Actuators, -1..1: numbers with bounds are scaled to these; with one bound, to the 2 next to it; others stay as
they are. For integers the range -1..1 has a bin for each, all of the same width. Of two choices the sign
decides, of more the largest of as many actuators, the first one among equals; where an action mask allows
some only, among these. Dictionaries and tuples follow one part after the other.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, SimulationError
from swarmwright.common.ranges import Range
from swarmwright.simulations.calls import short
from swarmwright.simulations.environments._masks import MASK, Allowed, mask_reader, mask_width

Numbers = NDArray[np.float64]
_Made = TypeVar("_Made")

_UNBOUNDED = 1e6
"""Bounds from here on are none: some environments write a large number for infinity."""


class Sensors(NamedTuple):
    """How an observation becomes numbers."""

    width: int
    read: Callable[[Any], Numbers]
    """Observation -> (width,)"""
    ranges: tuple[Range | None, ...]
    """What -1 and 1 of each stand for; None where numbers stay as they are."""


class Actuators(NamedTuple):
    """How numbers become an action."""

    width: int
    act: Callable[..., Any]
    """(width,), -1 to 1, and optionally the choices that are allowed -> action"""
    ranges: tuple[Range | None, ...]
    """What -1 and 1 of each stand for; None where they stand for themselves, or choose."""


def with_mask(observations: Any, actions: Any, where: str) -> tuple[Sensors, Callable[[Any], Allowed | None]]:  # noqa: ANN401 - spaces of an environment
    """Return the sensors for an observation space, and what reads which choices an observation allows.

    See `sensors`; an action mask is no sensor, where it is one of these actions.
    """
    if not mask_width(observations, actions):
        return sensors(observations, where), lambda _: None
    seen = spaces.Dict({key: part for key, part in observations.spaces.items() if key != MASK})
    place = f"{where}[{MASK!r}]"

    def refuse(mask: Any) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
        if mask is None:
            raise SimulationError(f"{where}: an observation without {MASK!r}, which its space has")
        _refuse(mask, observations.spaces[MASK], place)

    return sensors(seen, where), mask_reader(observations, actions, refuse)


def sensors(space: Any, where: str) -> Sensors:  # noqa: ANN401 - whatever an environment says
    """Return the sensors for an observation space. Raises InputError for one whose size changes.

    Reading raises SimulationError for an observation of another size, or a choice that there is not. Whether
    numbers are within their bounds is not checked: many environments exceed them.
    """
    _check_there(space, where)
    match space:
        case spaces.Box():
            middle, half = _range(space)

            def numbers(seen: Any) -> Numbers:  # noqa: ANN401 - an array
                return (_flat(seen, half.size, space, where) - middle) / half

            return Sensors(half.size, numbers, ranges(middle, half))
        case spaces.Discrete():
            return _choice_of_one(space, where)
        case spaces.MultiBinary():
            size = int(np.prod(space.shape))

            def flags(seen: Any) -> Numbers:  # noqa: ANN401 - an array of 0 and 1
                row = _flat(seen, size, space, where)
                if not ((row == 0) | (row == 1)).all():
                    _refuse(seen, space, where)
                return row

            return Sensors(size, flags, (None,) * size)
        case spaces.MultiDiscrete():
            return _choices(space, where)
        case spaces.Dict() | spaces.Tuple():
            return _parts(space, where)
    raise InputError(
        f"{where}: a {type(space).__name__} space cannot be read by sensors, whose number is fixed; "
        "wrap the environment so that it gives a Box"
    )


def _choice_of_one(space: spaces.Discrete, where: str) -> Sensors:
    count, start = int(space.n), int(space.start)

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - an integer
        try:
            index = int(seen) - start
        except (TypeError, ValueError, OverflowError):
            _refuse(seen, space, where)
        if not 0 <= index < count or index + start != seen:
            _refuse(seen, space, where)
        row = np.zeros(count)
        row[index] = 1
        return row

    return Sensors(count, read, (None,) * count)


def _choices(space: spaces.MultiDiscrete, where: str) -> Sensors:
    counts, starts = space.nvec.ravel(), space.start.ravel()
    ends = np.cumsum(counts)
    width = int(ends[-1])

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - an array of integers
        picked = _flat(seen, counts.size, space, where) - starts
        if not ((picked >= 0) & (picked < counts) & (picked % 1 == 0)).all():
            _refuse(seen, space, where)
        row = np.zeros(width)
        row[ends - counts + picked.astype(np.int64)] = 1
        return row

    return Sensors(width, read, (None,) * width)


def _parts(space: Any, where: str) -> Sensors:  # noqa: ANN401 - a Dict or a Tuple
    keys, parts = _inner(space, where, sensors)
    found = tuple(one for part in parts for one in part.ranges)

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - a dictionary or tuple
        try:
            values = [seen[key] for key in keys]
        except (TypeError, LookupError):
            _refuse(seen, space, where)
        return np.concatenate([part.read(value) for part, value in zip(parts, values, strict=True)])

    return Sensors(len(found), read, found)


def _inner(space: Any, where: str, made: Callable[[Any, str], _Made]) -> tuple[list[Any], list[_Made]]:  # noqa: ANN401 - a Dict or a Tuple
    """Return the keys of a space's parts, and what is made of each. Raises InputError where it has none."""
    inner: list[tuple[Any, Any]] = list(
        space.spaces.items() if isinstance(space, spaces.Dict) else enumerate(space.spaces)
    )
    if not inner:
        raise InputError(f"{where}: a {type(space).__name__} space without parts")
    return [key for key, _ in inner], [made(part, f"{where}[{key!r}]") for key, part in inner]


def _flat(seen: Any, size: int, space: Any, where: str) -> Numbers:  # noqa: ANN401 - whatever an environment returns
    """Return an observation as a row of so many numbers. Raises SimulationError for others."""
    try:
        row = np.asarray(seen, float).ravel()
    except (TypeError, ValueError):
        _refuse(seen, space, where)
    if row.size != size:
        _refuse(seen, space, where)
    return row


def _refuse(seen: Any, space: Any, where: str) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
    shape = getattr(seen, "shape", ())
    found = f"{short(seen)} of the shape {shape}" if shape else short(seen)
    if shape and shape != getattr(space, "shape", None):
        # The numbers differ from episode to episode, what is wrong does not.
        found = f"of the shape {shape}"
    expected = f"Box{space.shape}" if isinstance(space, spaces.Box) else short(space)
    raise SimulationError(f"{where}: the observation {found} is not in {expected}")


def actuators(space: Any, where: str) -> Actuators:  # noqa: ANN401 - whatever an environment says
    """Return the actuators for an action space. Raises InputError for one that cannot be steered."""
    _check_there(space, where)
    match space:
        case spaces.Box():
            if np.issubdtype(space.dtype, np.integer):
                return _integers(space)
            middle, half = _reach(space)
            shape, kind = space.shape, space.dtype

            def scaled(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
                action = (middle + half * row).reshape(shape).astype(kind)
                return np.clip(action, space.low, space.high)

            return Actuators(half.size, scaled, ranges(middle, half))
        case spaces.Discrete():
            width, choose = _choice(int(space.n))
            start = int(space.start)

            def one(row: Numbers, allowed: Allowed | None = None) -> int:
                return start + choose(row, allowed)

            return Actuators(width, one, (None,) * width)
        case spaces.MultiDiscrete():
            return _several(space)
        case spaces.MultiBinary():
            shape, bits = space.shape, int(np.prod(space.shape))

            def flags(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
                return (row > 0).astype(np.int8).reshape(shape)

            return Actuators(bits, flags, (None,) * bits)
        case spaces.Dict() | spaces.Tuple():
            return _action_parts(space, where)
    raise InputError(
        f"{where}: a {type(space).__name__} space cannot be steered by actuators; "
        "wrap the environment so that it takes a Box or a Discrete"
    )


def _several(space: spaces.MultiDiscrete) -> Actuators:
    counts = space.nvec.ravel().tolist()
    choices = [_choice(int(count)) for count in counts]
    ends = np.cumsum([width for width, _ in choices])
    firsts, shape, choice_ends = space.start, space.nvec.shape, np.cumsum(counts)

    def several(row: Numbers, allowed: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        parts = np.split(row, ends[:-1])
        masks = [None] * len(parts) if allowed is None else np.split(allowed, choice_ends[:-1])
        each = zip(choices, parts, masks, strict=True)
        picked = [choose(part, mask) for (_, choose), part, mask in each]
        return (firsts + np.reshape(picked, shape)).astype(space.dtype)

    return Actuators(int(ends[-1]), several, (None,) * int(ends[-1]))


def _action_parts(space: Any, where: str) -> Actuators:  # noqa: ANN401 - a Dict or a Tuple
    keys, parts = _inner(space, where, actuators)
    ends = np.cumsum([part.width for part in parts])

    def act(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        rows = np.split(row, ends[:-1])
        actions = [part.act(own) for part, own in zip(parts, rows, strict=True)]
        return dict(zip(keys, actions, strict=True)) if isinstance(space, spaces.Dict) else tuple(actions)

    return Actuators(int(ends[-1]), act, tuple(one for part in parts for one in part.ranges))


def ranges(middle: NDArray[Any], half: NDArray[Any]) -> tuple[Range | None, ...]:
    """Return what -1 and 1 of scaled numbers stand for: middle and half the width of the range of each."""
    parts = zip(np.ravel(half).tolist(), np.ravel(middle).tolist(), strict=True)
    return tuple(Range.scaled(*part) for part in parts)


def _range(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle of each number's range and half its width, flat; 0 and 1 where it has no bounds."""
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    bounded = (low > -_UNBOUNDED) & (high < _UNBOUNDED) & (low < high)
    low, high = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return (low + high) / 2, (high - low) / 2


def _reach(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle of what each actuator reaches and half its width, flat.

    The bounds; the 2 next to the only bound; -1 to 1 without any.
    """
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    above, below = low > -_UNBOUNDED, high < _UNBOUNDED
    least = np.where(above, low, np.where(below, high - 2, -1.0))
    most = np.where(below, high, np.where(above, low + 2, 1.0))
    return (least + most) / 2, (most - least) / 2


def _integers(space: spaces.Box) -> Actuators:
    """Return the actuators for integers: -1 to 1 is divided into as many bins as there are integers.

    With one bound there are the 3 next to it, without any -1, 0 and 1.
    """
    firsts, counts = [], []
    # Python's integers: differences of 64-bit bounds do not fit into 64 bits.
    for low, high in zip(space.low.ravel().tolist(), space.high.ravel().tolist(), strict=True):
        above, below = low > -_UNBOUNDED, high < _UNBOUNDED
        count = high - low + 1 if above and below else min(3, high - low + 1)
        firsts.append(low if above else high - count + 1 if below else -1)
        counts.append(count)
    shape, kind = space.shape, space.dtype
    # Wider than the type, in which a sum with the number of a bin may not fit.
    wide = np.uint64 if kind == np.uint64 else np.int64
    first, bins = np.array(firsts, wide), np.array(counts, float)

    def picked(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        index = np.clip(np.floor(bins * (row + 1) / 2), 0, bins - 1)
        return (first + index.astype(wide)).astype(kind).reshape(shape)

    # The number of a bin is that of a value of this range, rounded.
    return Actuators(bins.size, picked, ranges(first + (bins - 1) / 2, bins / 2))


def _check_there(space: Any, where: str) -> None:  # noqa: ANN401 - whatever an environment says
    if space is None:
        raise InputError(f"{where}: is missing; an environment has to say what is observed and done in it")


def _choice(count: int) -> tuple[int, Callable[[Numbers, Allowed | None], int]]:
    """Return how many actuators choose one of `count`, and how; of those that are allowed, if any is."""
    if count > 2:

        def largest(row: Numbers, allowed: Allowed | None) -> int:
            if allowed is not None and allowed.any():
                row = np.where(allowed, row, -np.inf)
            return int(row.argmax())

        return count, largest

    def sign(row: Numbers, allowed: Allowed | None) -> int:
        picked = int(row[0] > 0 and count == 2)
        if allowed is not None and allowed.any() and not allowed[picked]:
            picked = 1 - picked
        return picked

    return 1, sign
