"""Sequences of sensors, and the actuators that the engine's controller gives for them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.values import ComparedByValue
from swarmwright.controllers.kinds import kind_of, part

RANDOM_SEQUENCES = 10_000
LONGEST = 30
_OPERATIONS = 1e8
"""Of nodes, at most, in all random sequences together: so that large networks are verified in minutes."""

_LARGEST_SENSED = np.float32(1000)
_BITS = [
    0x00000000, 0x80000000, 0x00000001, 0x80000001, 0x007FFFFF, 0x00800000, 0x34000000, 0x3F7FFFFF,
    0x3F800000, 0xBF800000, 0x3F800001, 0x4B800000, 0x7149F2CA, 0xF149F2CA, 0x7F7FFFFF, 0xFF7FFFFF,
]  # fmt: skip
"""Zeros, subnormal and smallest normal numbers, neighbours of 1, huge numbers."""
_REFUSED = [0x7FC00000, 0x7F800000, 0xFF800000]
"""NaN and infinities."""


@dataclass(frozen=True, eq=False)
class Sequences(ComparedByValue):
    """Steps of one controller, some of which begin a sequence."""

    first: NDArray[np.bool_]
    """(steps,) whether the controller is reset before the step."""
    sensors: NDArray[np.float32]
    """(steps, sensors)"""
    actuators: NDArray[np.float32]
    """(steps, actuators); rows of refused steps hold nothing."""
    accepted: NDArray[np.bool_]
    """(steps,) False where the controller refuses the sensors, and keeps its state; see `computed`."""
    may_overflow: NDArray[np.bool_] | None = None
    """(steps,) where a recurrent network may have overflowed, see `possible_overflows`; None for nowhere."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.first)

    @property
    def count(self) -> int:
        """Number of sequences."""
        return int(self.first.sum())

    def until(self, steps: int) -> "Sequences":
        """Return the whole sequences at the beginning that have so many steps at most, one at least."""
        ends = [*np.flatnonzero(self.first)[1:].tolist(), len(self)]
        end = max([ends[0], *(end for end in ends if end <= steps)])
        return self.part(slice(end))

    def part(self, part: slice | NDArray[np.bool_]) -> "Sequences":
        """Return some of the steps, those at the beginning of their sequences."""
        overflows = None if self.may_overflow is None else self.may_overflow[part]
        return Sequences(
            self.first[part], self.sensors[part], self.actuators[part], self.accepted[part], overflows
        )

    @classmethod
    def computed(
        cls,
        specification: Mapping[str, Any],
        first: NDArray[np.bool_],
        sensors: NDArray[np.float32],
        accepted: NDArray[np.bool_] | None = None,
    ) -> "Sequences":
        """Return what the engine's controller does in these steps; of modules in Python, what these do.

        Args:
            specification: of the controller.
            first: (steps,) whether the controller is reset before the step.
            sensors: (steps, sensors)
            accepted: (steps,) which steps are done; by default those without a sensor that is NaN or
                infinite, and without a random number of modules that is not from 0 to 1.
        """
        if accepted is None:
            accepted = accepted_steps(specification, sensors)
        if kind_of(specification).swarm:
            return _in_python(specification, first, sensors, accepted)
        with engine_errors("controller: "):
            controller = _engine.Controller(json.dumps(dict(specification), allow_nan=False))
        actuators = np.zeros((len(first), controller.actuators), np.float32)
        for step, (begins, row, fits) in enumerate(
            zip(first.tolist(), sensors, accepted.tolist(), strict=True)
        ):
            if begins:
                controller.reset()
            if fits:
                actuators[step] = controller.step(row)
        return cls(
            first, sensors, actuators, accepted, possible_overflows(specification, first, actuators, accepted)
        )


def accepted_steps(
    specification: Mapping[str, Any], sensors: NDArray[np.float32], *, checks_random: bool = True
) -> NDArray[np.bool_]:
    """Return which steps, (steps,), exported controllers do not refuse.

    Args:
        specification: of the controller.
        sensors: (steps, sensors)
        checks_random: modules refuse a random number that is not from 0 to 1, see `Subject.checks_random`.
    """
    accepted: NDArray[np.bool_] = np.array(np.isfinite(sensors).all(axis=1))
    sensor = kind_of(specification).random_sensor
    if checks_random and sensor is not None:
        random = sensors[:, sensor]
        accepted &= (random >= 0) & (random <= 1)
    return accepted


def possible_overflows(
    specification: Mapping[str, Any],
    first: NDArray[np.bool_],
    actuators: NDArray[np.float32],
    accepted: NDArray[np.bool_],
) -> NDArray[np.bool_] | None:
    """Return where a recurrent network may have overflowed, None for other kinds.

    The engine's network is then NaN in all nodes for ever, and its actuators are 0; an exported one refuses
    steps until it is reset. That may be so in the steps at the end of a sequence in which all actuators are
    0, and in the one before, in which some may be.

    Args:
        specification: of the controller.
        first: (steps,) whether a sequence begins.
        actuators: (steps, actuators)
        accepted: (steps,)
    """
    if not kind_of(specification).overflows:
        return None
    found = np.zeros(len(first), np.bool_)
    moves = accepted & actuators.view(np.uint32).any(axis=1)
    for begin, end in pairwise([*np.flatnonzero(first).tolist(), len(first)]):
        moving = np.flatnonzero(moves[begin:end])
        found[begin + int(moving.max(initial=0)) : end] = True
    return found


def _in_python(
    specification: Mapping[str, Any],
    first: NDArray[np.bool_],
    sensors: NDArray[np.float32],
    accepted: NDArray[np.bool_],
) -> Sequences:
    """Return what a machine with modules in Python does, all sequences side by side."""
    swarm = part(kind_of(specification).swarm)(
        specification, np.array([specification["weights"]], dtype=np.float32)
    )
    starts = np.flatnonzero(first)
    lengths = np.diff([*starts.tolist(), len(first)])
    actuators = np.zeros((len(first), int(specification["actuators"])), np.float32)
    swarm.restart(np.zeros(len(starts), dtype=np.int64))
    for step in range(int(lengths.max(initial=0))):
        going = np.flatnonzero(lengths > step)
        going = going[accepted[starts[going] + step]]
        rows = starts[going] + step
        actuators[rows] = swarm.step(going, sensors[rows])
    return Sequences(first, sensors, actuators, accepted)


def random_sequences(
    specification: Mapping[str, Any],
    count: int = RANDOM_SEQUENCES,
    *,
    refused: bool = True,
    longest: int = LONGEST,
    checks_random: bool = True,
) -> Sequences:
    """Return sequences of 1 to `longest` steps, the same ones for the same controller.

    Sensors are uniform in -1..1, or larger and smaller by up to forty orders of magnitude, or numbers at
    which arithmetic and thresholds change: zeros, subnormal, huge ones.

    refused: some steps have a sensor that is NaN or infinite, or a random number outside of 0 to 1. Of a
    machine with modules in Python, sensors are in -1000..1000: what these do with others is their author's.

    checks_random: see `accepted_steps`; without it the sensor of random numbers is as the others.
    """
    width = int(specification["sensors"])
    numbers = np.random.default_rng(2026)
    operations = len(specification["weights"]) * int(specification.get("iterations", 1)) * count
    longest = int(min(longest, max(4, 2 * _OPERATIONS / max(operations, 1))))
    lengths = numbers.integers(1, longest + 1, count)
    first = np.zeros(int(lengths.sum()), np.bool_)
    first[np.concatenate([[0], np.cumsum(lengths)[:-1]])] = True
    which = np.repeat(np.arange(count) % 4, lengths)
    sensors = numbers.uniform(-1, 1, (len(first), width))
    sensors[which == 1] *= 10
    magnitudes = 10.0 ** numbers.uniform(-45, 38, (len(first), width))
    sensors = np.where((which == 2)[:, None], sensors * magnitudes, sensors).astype(np.float32)
    special = _special(specification)
    chosen = special[numbers.integers(0, len(special), sensors.shape)]
    share = np.array([0.02, 0.02, 0.05, 0.5])[which]
    sensors = np.where(numbers.random(sensors.shape) < share[:, None], chosen, sensors)
    kind = kind_of(specification)
    if checks_random and kind.random_sensor is not None:
        outside = refused & (numbers.random(len(first)) < 0.02)
        sensors[~outside, kind.random_sensor] = numbers.random(len(first), np.float32)[~outside]
    if kind.swarm:
        sensors = np.clip(sensors, -_LARGEST_SENSED, _LARGEST_SENSED)
    if refused:
        bad = np.flatnonzero(numbers.random(len(first)) < 0.01)
        values = np.array(_REFUSED, np.uint32).view(np.float32)
        sensors[bad, numbers.integers(0, width, len(bad))] = values[numbers.integers(0, 3, len(bad))]
    drawn = np.ascontiguousarray(sensors, np.float32)
    accepted = accepted_steps(specification, drawn, checks_random=checks_random)
    return Sequences.computed(specification, first, drawn, accepted)


def _special(specification: Mapping[str, Any]) -> NDArray[np.float32]:
    thresholds = [sequence for of_one in specification.get("thresholds", ()) for sequence in of_one]
    edges = np.array(thresholds, np.float32)
    near = [np.nextafter(edges, np.float32(way), dtype=np.float32) for way in (-np.inf, np.inf)]
    found: NDArray[np.float32] = np.concatenate([np.array(_BITS, np.uint32).view(np.float32), edges, *near])
    return found[np.isfinite(found)]


def difference(expected: Sequences, found: NDArray[np.float32]) -> tuple[float, int]:
    """Return the largest absolute difference of actuators, and how many differ in their bits.

    found: (steps, actuators). Raises InputError for another shape, which a program that stopped early gives.
    """
    if found.shape != expected.actuators.shape:
        raise InputError(
            f"verification: {found.shape} actuators came back, expected {expected.actuators.shape}"
        )
    right, given = expected.actuators[expected.accepted], found[expected.accepted]
    other = int((right.view(np.uint32) != given.view(np.uint32)).sum())
    distance = np.abs(right.astype(np.float64) - given.astype(np.float64))
    distance[np.isnan(distance)] = np.inf
    return float(distance.max(initial=0.0)), other
