"""Pseudo-random steps of self-tests, which cover more of a controller than recorded episodes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.kinds import import_part, kind_of
from swarmwright.export.golden import find_steps_before_overflow
from swarmwright.export.sequences import Sequences, find_accepted
from swarmwright.export.subject import Subject

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
