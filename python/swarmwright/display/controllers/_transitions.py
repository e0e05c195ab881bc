"""What a Mealy machine's table says, in short: from each state to which, when, and what it does there."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.display.controllers._names import Names


@dataclass(frozen=True)
class Transition:
    """All rows of the table that lead from one state to another."""

    source: int
    target: int
    rows: int
    """Combinations of intervals that lead there."""
    of: int
    """Combinations there are."""
    condition: str
    """What all these rows have in common: `goal x > 0, defender y <= 0.5`; empty when nothing."""
    exact: bool
    """Whether the condition says everything: every row for which it holds leads there."""
    lowest: NDArray[np.float64]
    """(actuators,), lowest output on the way."""
    highest: NDArray[np.float64]
    """(actuators,), highest output on the way."""


def transitions(specification: Mapping[str, Any], names: Names) -> list[Transition]:
    """Return the transitions of a `mealy_fsm`, by source and then by target."""
    states, thresholds = specification["states"], specification["thresholds"]
    sizes = [len(of_one) + 1 for of_one in thresholds]
    combinations = math.prod(sizes)
    table = np.array(specification["weights"], dtype=np.float64).reshape(states, combinations, -1)
    targets = np.clip(np.floor(table[:, :, 0]), 0, states - 1).astype(int)
    outputs = np.clip(table[:, :, 1:], -1.0, 1.0)
    intervals = np.array(np.unravel_index(np.arange(combinations), sizes)).T  # (combinations, sensors)
    found = []
    for source in range(states):
        for target in np.unique(targets[source]):
            chosen = targets[source] == target
            condition, covered = _common(intervals[chosen], thresholds, names, sizes)
            rows = int(chosen.sum())
            there = outputs[source][chosen]
            found.append(
                Transition(
                    source, int(target), rows, combinations, condition, rows == covered,
                    there.min(axis=0), there.max(axis=0),
                )
            )  # fmt: skip
    return found


def reachable(found: list[Transition]) -> set[int]:
    """Return the states that an episode, which begins in state 0, can come to."""
    seen, new = {0}, {0}
    while new:
        new = {one.target for one in found if one.source in new} - seen
        seen |= new
    return seen


def _common(
    intervals: NDArray[np.int64], thresholds: list[list[float]], names: Names, sizes: list[int]
) -> tuple[str, int]:
    """Return what combinations of intervals have in common, and how many combinations that holds for."""
    words = []
    covered = 1
    for name, of_one, size, column in zip(names.sensors, thresholds, sizes, intervals.T, strict=True):
        low, high = int(column.min()), int(column.max())
        covered *= high - low + 1
        if low == 0 and high == size - 1:
            continue
        # A sensor is in interval i when i thresholds are less than it.
        if low == 0:
            words.append(f"{name} ≤ {of_one[high]:.3g}")
        elif high == size - 1:
            words.append(f"{name} > {of_one[low - 1]:.3g}")
        else:
            words.append(f"{of_one[low - 1]:.3g} < {name} ≤ {of_one[high]:.3g}")
    return ", ".join(words), covered
