"""Sequences of sensors, and the actuators that the engine's controller computes."""

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
from swarmwright.controllers.kinds import import_part, kind_of

RANDOM_SEQUENCES = 10_000
LONGEST = 30
_OPERATIONS = 1e8
"""Largest number of node operations in all random sequences, so that large networks are verified within
minutes."""

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
    """Steps of a controller, divided into sequences."""

    first: NDArray[np.bool_]
    """(steps,) whether the controller is reset before the step."""
    sensors: NDArray[np.float32]
    """(steps, sensors)"""
    actuators: NDArray[np.float32]
    """(steps, actuators); rows of refused steps are meaningless."""
    accepted: NDArray[np.bool_]
    """(steps,) False if the controller refuses the sensors and keeps its state; see `compute`."""
    may_overflow: NDArray[np.bool_] | None = None
    """(steps,) whether a recurrent network may have overflowed, see `find_possible_overflows`; None:
    never."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.first)

    @property
    def count(self) -> int:
        """Number of sequences."""
        return int(self.first.sum())

    def take_first(self, steps: int) -> "Sequences":
        """Return the first whole sequences with at most `steps` steps, but at least one sequence."""
        ends = [*np.flatnonzero(self.first)[1:].tolist(), len(self)]
        end = max([ends[0], *(end for end in ends if end <= steps)])
        return self.part(slice(end))

    def part(self, selection: slice | NDArray[np.bool_]) -> "Sequences":
        """Return the selected steps; the selection must not interrupt a sequence."""
        overflows = None if self.may_overflow is None else self.may_overflow[selection]
        return Sequences(
            self.first[selection],
            self.sensors[selection],
            self.actuators[selection],
            self.accepted[selection],
            overflows,
        )

    @classmethod
    def compute(
        cls,
        specification: Mapping[str, Any],
        first: NDArray[np.bool_],
        sensors: NDArray[np.float32],
        accepted: NDArray[np.bool_] | None = None,
    ) -> "Sequences":
        """Compute the actuators of the engine's controller, or of modules in Python.

        Args:
            specification: specification of the controller.
            first: (steps,) whether the controller is reset before the step.
            sensors: (steps, sensors)
            accepted: (steps,) which steps are executed; by default those with finite sensors and, for
                modules,
                a random number in 0..1.
        """
        if accepted is None:
            accepted = find_accepted(specification, sensors)
        if kind_of(specification).swarm:
            return _compute_in_python(specification, first, sensors, accepted)
        with engine_errors("controller: "):
            controller = _engine.Controller(json.dumps(dict(specification), allow_nan=False))
        actuators = np.zeros((len(first), controller.actuators), np.float32)
        for step, (begins, row, is_accepted) in enumerate(
            zip(first.tolist(), sensors, accepted.tolist(), strict=True)
        ):
            if begins:
                controller.reset()
            if is_accepted:
                actuators[step] = controller.step(row)
        return cls(
            first,
            sensors,
            actuators,
            accepted,
            find_possible_overflows(specification, first, actuators, accepted),
        )


def find_accepted(
    specification: Mapping[str, Any], sensors: NDArray[np.float32], *, checks_random: bool = True
) -> NDArray[np.bool_]:
    """Return a mask, (steps,), of the steps that exported controllers accept.

    Args:
        specification: specification of the controller.
        sensors: (steps, sensors)
        checks_random: whether modules refuse a random number outside 0..1, see `Subject.checks_random`.
    """
    accepted: NDArray[np.bool_] = np.array(np.isfinite(sensors).all(axis=1))
    sensor = kind_of(specification).random_sensor
    if checks_random and sensor is not None:
        random = sensors[:, sensor]
        accepted &= (random >= 0) & (random <= 1)
    return accepted


def find_possible_overflows(
    specification: Mapping[str, Any],
    first: NDArray[np.bool_],
    actuators: NDArray[np.float32],
    accepted: NDArray[np.bool_],
) -> NDArray[np.bool_] | None:
    """Return a mask of steps in which a recurrent network may have overflowed; None for other kinds.

    After an overflow, all nodes of the engine's network are NaN and its actuators 0; an exported network
    refuses steps until a reset. This is possible in the last steps of a sequence in which all actuators are
    0, and in the step before them.

    Args:
        specification: specification of the controller.
        first: (steps,) whether a sequence begins.
        actuators: (steps, actuators)
        accepted: (steps,)
    """
    if not kind_of(specification).overflows:
        return None
    mask = np.zeros(len(first), np.bool_)
    moves = accepted & actuators.view(np.uint32).any(axis=1)
    for begin, end in pairwise([*np.flatnonzero(first).tolist(), len(first)]):
        moving = np.flatnonzero(moves[begin:end])
        mask[begin + int(moving.max(initial=0)) : end] = True
    return mask


def _compute_in_python(
    specification: Mapping[str, Any],
    first: NDArray[np.bool_],
    sensors: NDArray[np.float32],
    accepted: NDArray[np.bool_],
) -> Sequences:
    """Compute the actuators of a machine with modules in Python, for all sequences at once."""
    swarm = import_part(kind_of(specification).swarm)(
        specification, np.array([specification["weights"]], dtype=np.float32)
    )
    starts = np.flatnonzero(first)
    lengths = np.diff([*starts.tolist(), len(first)])
    actuators = np.zeros((len(first), int(specification["actuators"])), np.float32)
    swarm.restart(np.zeros(len(starts), dtype=np.int64))
    for step in range(int(lengths.max(initial=0))):
        active = np.flatnonzero(lengths > step)
        active = active[accepted[starts[active] + step]]
        rows = starts[active] + step
        actuators[rows] = swarm.step(active, sensors[rows])
    return Sequences(first, sensors, actuators, accepted)


def draw_random_sequences(
    specification: Mapping[str, Any],
    count: int = RANDOM_SEQUENCES,
    *,
    refused: bool = True,
    longest: int = LONGEST,
    checks_random: bool = True,
) -> Sequences:
    """Return sequences of 1 to `longest` steps, the same for the same controller.

    Sensors are uniform in -1..1, or larger and smaller by up to forty orders of magnitude, or special numbers
    for arithmetic and thresholds: zeros, subnormal, huge numbers.

    refused: whether some steps have NaN or infinite sensors, or a random number outside 0..1. For a machine
    with modules in Python, sensors are in -1000..1000, since its modules may not support other values.

    checks_random: see `find_accepted`; without it the random sensor is like the others.
    """
    width = int(specification["sensors"])
    numbers = np.random.default_rng(2026)
    operations = len(specification["weights"]) * int(specification.get("iterations", 1)) * count
    longest = int(min(longest, max(4, 2 * _OPERATIONS / max(operations, 1))))
    lengths = numbers.integers(1, longest + 1, count)
    first = np.zeros(int(lengths.sum()), np.bool_)
    first[np.concatenate([[0], np.cumsum(lengths)[:-1]])] = True
    sequence_kind = np.repeat(np.arange(count) % 4, lengths)
    sensors = numbers.uniform(-1, 1, (len(first), width))
    sensors[sequence_kind == 1] *= 10
    magnitudes = 10.0 ** numbers.uniform(-45, 38, (len(first), width))
    sensors = np.where((sequence_kind == 2)[:, None], sensors * magnitudes, sensors).astype(np.float32)
    special = _special_numbers(specification)
    chosen = special[numbers.integers(0, len(special), sensors.shape)]
    share = np.array([0.02, 0.02, 0.05, 0.5])[sequence_kind]
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
    accepted = find_accepted(specification, drawn, checks_random=checks_random)
    return Sequences.compute(specification, first, drawn, accepted)


def _special_numbers(specification: Mapping[str, Any]) -> NDArray[np.float32]:
    thresholds = [edge for edges in specification.get("thresholds", ()) for edge in edges]
    edges = np.array(thresholds, np.float32)
    neighbours = [
        np.nextafter(edges, np.float32(direction), dtype=np.float32) for direction in (-np.inf, np.inf)
    ]
    numbers: NDArray[np.float32] = np.concatenate(
        [np.array(_BITS, np.uint32).view(np.float32), edges, *neighbours]
    )
    return numbers[np.isfinite(numbers)]


def measure_difference(expected: Sequences, actuators: NDArray[np.float32]) -> tuple[float, int]:
    """Return the largest absolute difference of actuators, and the number of actuators whose bits differ.

    actuators: (steps, actuators). Raises InputError for another shape, as of a program that stopped early.
    """
    if actuators.shape != expected.actuators.shape:
        raise InputError(
            f"verification: the program returned {actuators.shape} actuators, expected "
            f"{expected.actuators.shape}"
        )
    right, computed = expected.actuators[expected.accepted], actuators[expected.accepted]
    differing = int((right.view(np.uint32) != computed.view(np.uint32)).sum())
    distance = np.abs(right.astype(np.float64) - computed.astype(np.float64))
    distance[np.isnan(distance)] = np.inf
    return float(distance.max(initial=0.0)), differing
