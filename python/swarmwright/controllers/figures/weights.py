"""A network's weights as arrays, and their colours."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.kinds.neat import specification as neat

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
    """Return whether nodes may see any node."""
    return specification["kind"] in {"fully_meshed", "hebbian", "neat"}


def layers(specification: Mapping[str, Any]) -> list[Layer]:
    """Return the layers of a `layered`, a `fully_meshed`, a `hebbian` or a `neat` network."""
    sizes = columns(specification)
    if specification["kind"] == neat.KIND:
        return list(_connected(specification, sizes))
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


def _connected(specification: Mapping[str, Any], sizes: list[int]) -> Iterator[Layer]:
    """Yield each node of a `neat` network; the slopes of actuators are left out."""
    places = [(column, index) for column, size in enumerate(sizes) for index in range(size)]
    rows = neat.rows(specification, np.array(specification["weights"], dtype=np.float32))
    for (column, index), (seen, numbers, _) in zip(places[sizes[0] :], rows, strict=True):
        weights = numbers[np.newaxis, 1 : 1 + len(seen)].astype(np.float64)
        yield Layer(
            tuple(places[one] for one in seen), column, index, numbers[:1].astype(np.float64), weights
        )


def matrices(specification: Mapping[str, Any]) -> list[Layer]:
    """Return the layers with a matrix for each column: in a `neat` network 0 without a connection."""
    found = layers(specification)
    if specification["kind"] != neat.KIND:
        return found
    sizes = columns(specification)
    everything = tuple((column, index) for column, size in enumerate(sizes) for index in range(size))
    places = {place: index for index, place in enumerate(everything)}
    result = []
    for column, size in enumerate(sizes[1:], 1):
        weights = np.zeros((size, len(everything)))
        nodes = [layer for layer in found if layer.column == column]
        for row, layer in zip(weights, nodes, strict=True):
            np.add.at(row, [places[source] for source in layer.sources], layer.weights[0])
        result.append(Layer(everything, column, 0, np.concatenate([layer.bias for layer in nodes]), weights))
    return result


def colormap() -> "LinearSegmentedColormap":
    """Return the colours from negative over nothing to positive."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("weights", [NEGATIVE, NOTHING, POSITIVE])


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest absolute value, 1 when all are 0."""
    return float(np.abs(values).max(initial=0.0)) or 1.0
