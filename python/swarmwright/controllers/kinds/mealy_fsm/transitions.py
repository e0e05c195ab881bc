"""A summary of a Mealy machine's table: transitions, their conditions and outputs."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.drawing import Names

Box = list[tuple[int, int]]
"""For each sensor its first and its last interval."""

_MOST_BOXES = 3
"""Most parts of a condition that is written out."""
_BEGINNINGS = 8
"""Combinations from which a box is tried to be grown."""


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
    """When: `goal x > 0, defender y ≤ 0.5; or goal y > 0`; when it is not exact, its largest part alone."""
    exact: bool
    """Whether the condition says everything: it holds for these rows and for no other."""
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
    found = []
    for source in range(states):
        for target in np.unique(targets[source]):
            chosen = targets[source] == target
            boxes, exact = _boxes(chosen.reshape(sizes))
            words = [_words(box, thresholds, names, sizes) for box in boxes]
            there = outputs[source][chosen]
            found.append(
                Transition(
                    source, int(target), int(chosen.sum()), combinations,
                    "; or ".join(words) if exact else words[0], exact, there.min(axis=0), there.max(axis=0),
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


def _boxes(chosen: NDArray[np.bool_]) -> tuple[list[Box], bool]:
    """Cover combinations of intervals with boxes, the largest ones first, greedily.

    chosen: an axis for each sensor; at least one is true.

    Returns:
        The boxes, few, and whether they cover everything.
    """
    left = chosen.copy()
    found: list[Box] = []
    while left.any() and len(found) < _MOST_BOXES:
        beginnings = np.argwhere(left)[:_BEGINNINGS]
        axes = range(chosen.ndim)
        candidates = [
            _grown(chosen, tuple(map(int, beginning)), order)
            for beginning in beginnings
            for order in (axes, reversed(axes))
        ]
        best = max(candidates, key=lambda box: int(left[_slices(box)].sum()))
        found.append(best)
        left[_slices(best)] = False
    return found, not left.any()


def _grown(chosen: NDArray[np.bool_], beginning: tuple[int, ...], order: Iterable[int]) -> Box:
    """Return a combination, widened axis after axis as far as all that it then holds is chosen."""
    box = [(place, place) for place in beginning]
    for axis in order:
        for step in (1, -1):
            while True:
                low, high = box[axis]
                wider = (low, high + 1) if step > 0 else (low - 1, high)
                if wider[0] < 0 or wider[1] >= chosen.shape[axis]:
                    break
                if not chosen[_slices([*box[:axis], wider, *box[axis + 1 :]])].all():
                    break
                box[axis] = wider
    return box


def _slices(box: Box) -> tuple[slice, ...]:
    return tuple(slice(low, high + 1) for low, high in box)


def _words(box: Box, thresholds: list[list[float]], names: Names, sizes: list[int]) -> str:
    words = []
    for name, of_one, size, (low, high) in zip(names.sensors, thresholds, sizes, box, strict=True):
        # A sensor is in interval i when i thresholds are less than it.
        if low == 0 and high == size - 1:
            continue
        if low == 0:
            words.append(f"{name} ≤ {of_one[high]:.3g}")
        elif high == size - 1:
            words.append(f"{name} > {of_one[low - 1]:.3g}")
        else:
            words.append(f"{of_one[low - 1]:.3g} < {name} ≤ {of_one[high]:.3g}")
    return ", ".join(words)
