"""Pseudo-random steps of self-tests, which try more of a controller than recorded episodes do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.kinds import kind_of, part
from swarmwright.export.golden import before_overflow
from swarmwright.export.sequences import Sequences, accepted_steps
from swarmwright.export.subject import Subject

_STEPS = 256
_MOST_STEPS = 4096
"""Of a state machine, until all rows were visited."""
_RESTART = 64
"""Steps from reset to reset, at least."""
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
    """Steps whose sensors a generator draws, and what the controller does in them."""

    probes: NDArray[np.float32]
    """What sensors are."""
    probes_of: tuple[tuple[int, int], ...]
    """Of each sensor: its first probe, and of how many one is drawn."""
    restart: int
    """Steps from reset to reset."""
    steps: int
    checksum: int
    """Of the bits of all actuators, 32 bits; see `checksum`."""
    words: str
    """What the steps try."""


def walk_of(subject: Subject) -> Walk:
    """Return the steps for a controller that steers agents, the same ones for the same controller."""
    specification = subject.specification
    sensors = int(specification["sensors"])
    visits = kind_of(specification).visits  # of tables, whose thresholds are tried
    tried = (
        [_probes(threshold) for threshold in specification["thresholds"]]
        if visits
        else [np.array([*_VALUES_WITHIN_0_1, *_NEGATIVE_VALUES], np.float32)]
    )
    counts = [len(values) for values in tried] if visits else _counts(subject, len(tried[0]))
    begins = np.cumsum([0, *map(len, tried)])[:-1].tolist() if visits else [0] * sensors
    probes = np.concatenate(tried)
    restart = max(_RESTART, 8 * int(specification.get("states", 1)))
    chosen = _drawn(_MOST_STEPS if visits else _STEPS, counts) + np.array(begins)
    rows = probes[chosen]
    words = f"{len(rows)} pseudo-random steps"
    if visits:
        length, words = part(visits)(specification, rows, restart, _STEPS)
        rows = rows[:length]
    first = np.arange(len(rows)) % restart == 0
    accepted = accepted_steps(specification, rows, checks_random=subject.checks_random)
    found = Sequences.computed(specification, first, rows, accepted)
    before = before_overflow(specification, found)
    if not before.all():
        rows = rows[: int(np.argmin(before))]
        words = f"{len(rows)} pseudo-random steps before a node overflows"
    of = tuple(zip(begins, counts, strict=True))
    return Walk(probes, of, restart, len(rows), checksum(found.actuators[: len(rows)]), words)


def checksum(actuators: NDArray[np.float32]) -> int:
    """Return what a self-test computes of the bits of actuators, in their order: FNV-1a with rotations."""
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


def _drawn(steps: int, counts: list[int]) -> NDArray[np.int64]:
    """Return the number of each sensor's probe, (steps, sensors), from a linear congruential generator."""
    number = 1
    found = np.empty((steps, len(counts)), np.int64)
    for step in range(steps):
        for sensor, count in enumerate(counts):
            number = (number * 1664525 + 1013904223) & 0xFFFFFFFF
            found[step, sensor] = (number >> 16) % count
    return found
