"""Golden vectors and pseudo-random walks for self-tests: steps, and the actuators of a controller."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import STEEP
from swarmwright.controllers.kinds import import_part, kind_of
from swarmwright.export.python_family import byte_text, python_module
from swarmwright.export.sequences import Sequences, find_accepted
from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Golden:
    """Episodes of some agents, or random sequences without a simulation."""

    sequences: Sequences
    """Whole sequences; for a network that overflows, the steps before the overflow."""
    words: str
    """Description of the sequences."""

    @classmethod
    def from_subject(cls, subject: Subject) -> Self:
        """Return the golden vectors of a controller that steers agents."""
        tried = subject.self_test_sequences
        golden = tried.part(find_steps_before_overflow(subject.specification, tried))
        steps = f"{len(golden)} steps"
        if len(golden) < len(tried):
            steps += " before a node overflows"
        if subject.episodes is None or not len(subject.episodes):
            return cls(golden, f"{golden.count} random sequences, {steps}")
        noun = "whole episodes" if len(golden) == len(tried) else "episodes"
        agents = f"{golden.count} agent{'' if golden.count == 1 else 's'}"
        return cls(golden, f"{noun} of {agents}, {steps}")

    def values(self) -> dict[str, str]:
        """Return the replacements for self-tests in Python."""
        return {"golden": self.words, "sequences": golden_text(self.sequences)}


def golden_text(golden: Sequences) -> str:
    """Format sequences as elements of a Python tuple: tuples of (sensors, actuators), both as bytes."""
    if not len(golden):
        return ""
    lines: list[str] = []
    for index in range(len(golden)):
        if golden.first[index]:
            lines += [*(["    ),"] if lines else []), "    ("]
        row = f"{byte_text(golden.sensors[index])}, {byte_text(golden.actuators[index])}"
        lines.append(f"        ({row}),")
    return "\n".join([*lines, "    ),"])


_WITHIN_1 = frozenset({"clamp", "sigmoid", STEEP, "tanh"})
"""Activations with results in -1..1."""


_SAFE = 1e38
"""A third of the largest binary32 number."""


def find_steps_before_overflow(specification: Mapping[str, Any], sequences: Sequences) -> NDArray[np.bool_]:
    """Return a mask, (steps,), of the steps before a node overflows in their sequence.

    The engine does not report overflows, so the exported Python module is executed. That takes about 0.1 us
    for each weight, iteration and step, unless weights and sensors exclude an overflow.

    Args:
        specification: specification of the controller.
        sequences: with finite sensors.
    """
    mask = np.ones(len(sequences), np.bool_)
    if not kind_of(specification).overflows or _is_bounded(specification, sequences.sensors):
        return mask
    module: dict[str, Any] = {"__name__": "controller"}
    exec(python_module(Subject(specification), "controller"), module)  # noqa: S102 - contains numbers only
    controller = module["Controller"]()
    for begin, end in pairwise([*np.flatnonzero(sequences.first).tolist(), len(sequences)]):
        controller.reset()
        for step in range(begin, end):
            try:
                controller.step(sequences.sensors[step].tolist())
            except ValueError:
                mask[step:end] = False
                break
    return mask


def _is_bounded(specification: Mapping[str, Any], sensors: NDArray[np.float32]) -> bool:
    """Whether no sum of a node can overflow, for any outputs of other nodes."""
    if specification.get("activation") not in _WITHIN_1:  # learning weights are unbounded
        return False
    computed = int(specification["hidden"]) + int(specification["actuators"])
    weights = np.abs(np.array(specification["weights"], np.float64)).reshape(computed, -1)
    largest = max(1.0, float(np.abs(sensors).max(initial=0.0)))
    return bool(weights.sum(axis=1).max() * largest < _SAFE)


_STEPS = 256
_MOST_STEPS = 4096
"""Largest number of steps for visiting all rows of a state machine."""
_RESTART = 64
"""Fewest steps between resets."""
_VALUES_WITHIN_0_1 = (
    0.0,
    1.0,
    0.5,
    0.25,
    0.75,
    0.1,
    0.95,
    0.0625,
    0.3,
    0.6,
    0.85,
    0.4375,
    0.71,
    0.03,
    0.9,
    0.15,
)
_NEGATIVE_VALUES = (-1.0, -0.5, -0.25, -0.1, -0.75, -0.03)


@dataclass(frozen=True)
class Walk:
    """Steps with sensors from a generator, and a checksum of the actuators."""

    probes: NDArray[np.float32]
    """Values of sensors."""
    sensor_probes: tuple[tuple[int, int], ...]
    """First probe and number of probes of each sensor."""
    restart: int
    """Steps between resets."""
    steps: int
    checksum: int
    """Checksum of all actuators, 32 bits; see `compute_checksum`."""
    words: str
    """Description of the steps."""


def generate_walk(subject: Subject) -> Walk:
    """Generate the steps for a controller that steers agents, the same for the same controller."""
    specification = subject.specification
    sensors = int(specification["sensors"])
    visits = kind_of(specification).visits  # for tables, whose thresholds are tested
    probe_sets = (
        [_probes(threshold) for threshold in specification["thresholds"]]
        if visits
        else [np.array([*_VALUES_WITHIN_0_1, *_NEGATIVE_VALUES], np.float32)]
    )
    counts = [len(values) for values in probe_sets] if visits else _counts(subject, len(probe_sets[0]))
    begins = np.cumsum([0, *map(len, probe_sets)])[:-1].tolist() if visits else [0] * sensors
    probes = np.concatenate(probe_sets)
    restart = max(_RESTART, 8 * int(specification.get("states", 1)))
    chosen = _draw_probes(_MOST_STEPS if visits else _STEPS, counts) + np.array(begins)
    rows = probes[chosen]
    words = f"{len(rows)} pseudo-random steps"
    if visits:
        length, words = import_part(visits)(specification, rows, restart, _STEPS)
        rows = rows[:length]
    first = np.arange(len(rows)) % restart == 0
    accepted = find_accepted(specification, rows, checks_random=subject.checks_random)
    sequences = Sequences.compute(specification, first, rows, accepted)
    before_overflow = find_steps_before_overflow(specification, sequences)
    if not before_overflow.all():
        rows = rows[: int(np.argmin(before_overflow))]
        words = f"{len(rows)} pseudo-random steps before a node overflows"
    sensor_probes = tuple(zip(begins, counts, strict=True))
    return Walk(
        probes, sensor_probes, restart, len(rows), compute_checksum(sequences.actuators[: len(rows)]), words
    )


def compute_checksum(actuators: NDArray[np.float32]) -> int:
    """Return the checksum of the bits of actuators in order: FNV-1a with rotations, as in self-tests."""
    total = 2166136261
    for bits in actuators.view(np.uint32).reshape(-1).tolist():
        rotated = (total << 5 | total >> 27) & 0xFFFFFFFF
        total = (rotated ^ bits) * 16777619 & 0xFFFFFFFF
    return total


def _counts(subject: Subject, probes: int) -> list[int]:
    counts = [probes] * int(subject.specification["sensors"])
    sensor = kind_of(subject.specification).random_sensor
    if sensor is not None and subject.checks_random:
        counts[sensor] = len(_VALUES_WITHIN_0_1)
    return counts


def _probes(thresholds: list[float]) -> NDArray[np.float32]:
    """Return values on both sides of each threshold of a sensor."""
    edges = np.array(thresholds, np.float32)
    above = np.nextafter(edges, np.float32(np.inf), dtype=np.float32)
    probes = np.unique(np.concatenate([edges, above]))
    probes = probes[np.isfinite(probes)]
    return probes if len(probes) else np.zeros(1, np.float32)


def _draw_probes(steps: int, counts: list[int]) -> NDArray[np.int64]:
    """Draw the index of each sensor's probe, (steps, sensors), with a linear congruential generator."""
    number = 1
    indices = np.empty((steps, len(counts)), np.int64)
    for step in range(steps):
        for sensor, count in enumerate(counts):
            number = (number * 1664525 + 1013904223) & 0xFFFFFFFF
            indices[step, sensor] = (number >> 16) % count
    return indices
