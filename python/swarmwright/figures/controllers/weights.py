"""A network's weights as arrays, and their colours."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap

NEGATIVE, NOTHING, POSITIVE = "#D55E00", "#F2F2EE", "#0072B2"
"""From Okabe and Ito's palette, which is safe for colour-blind readers."""


@dataclass(frozen=True)
class Layer:
    """Nodes that are computed together, and what they see."""

    sources: tuple[tuple[int, int], ...]
    """What they see: (column, index) of each, column 0 holds the sensors."""
    column: int
    """In which they are drawn; the last is that of the actuators."""
    first: int
    """Index in their column of the first one."""
    bias: NDArray[np.float64]
    """(nodes,)"""
    weights: NDArray[np.float64]
    """(nodes, sources)"""


def columns(specification: Mapping[str, Any]) -> list[int]:
    """Return how many nodes each column has: sensors, hidden ones, actuators."""
    hidden = specification["hidden"]
    between = list(hidden) if isinstance(hidden, list) else [hidden] if hidden else []
    return [specification["sensors"], *between, specification["actuators"]]


def is_recurrent(specification: Mapping[str, Any]) -> bool:
    """Return whether every node sees every node."""
    return specification["kind"] in {"fully_meshed", "hebbian"}


def layers(specification: Mapping[str, Any]) -> list[Layer]:
    """Return the layers of a `layered`, a `fully_meshed` or a `hebbian` network."""
    sizes = columns(specification)
    weights = np.array(specification["weights"], dtype=np.float64)
    if is_recurrent(specification):
        return _meshed(sizes, weights)
    found = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        seen = tuple((column - 1, index) for index in range(sizes[column - 1]))
        rows = weights[start : start + size * (len(seen) + 1)].reshape(size, len(seen) + 1)
        found.append(Layer(seen, column, 0, rows[:, 0], rows[:, 1:]))
        start += rows.size
    return found


def _meshed(sizes: list[int], weights: NDArray[np.float64]) -> list[Layer]:
    everything = tuple((column, index) for column, size in enumerate(sizes) for index in range(size))
    rows = weights.reshape(sum(sizes[1:]), len(everything) + 1)
    found = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        block = rows[start : start + size]
        found.append(Layer(everything, column, 0, block[:, 0], block[:, 1:]))
        start += size
    return found


def colormap() -> "LinearSegmentedColormap":
    """Return the colours from negative over nothing to positive."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("weights", [NEGATIVE, NOTHING, POSITIVE])


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest absolute value, 1 when all are 0."""
    return float(np.abs(values).max(initial=0.0)) or 1.0
