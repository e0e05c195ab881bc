"""Layered networks whose weights are a function of the positions of their nodes: HyperNEAT."""

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import Genomes
from swarmwright.common.problems import FieldError
from swarmwright.controllers._base import RepresentationOptions, split_rows
from swarmwright.controllers.kinds.growing.genomes import MOST_WEIGHTS, GrowingGenomes
from swarmwright.controllers.networks import OUTPUT_RANGE

PatternFunction = Literal["gaussian", "sine", "absolute", "tanh", "sigmoid", "linear"]
_FUNCTIONS = 6
Coordinate = Annotated[float, Field(ge=-10, le=10)]
Positions = Annotated[
    list[Annotated[list[Coordinate], Field(min_length=2, max_length=2)]], Field(min_length=1)
]
Count = Annotated[int, Field(ge=1, le=100)]
Sheet = Annotated[list[Count], Field(min_length=2, max_length=2)]


class HyperneatOptions(RepresentationOptions):
    """HyperNEAT: a layered network whose weights are computed from positions."""

    kind: Literal["hyperneat"] = "hyperneat"
    hidden: list[Sheet] = Field(default=[[4, 2]], max_length=20)
    """Columns and rows of each hidden sheet, in -1 to 1."""
    activation: Literal["tanh", "sigmoid", "relu", "clamp", "linear"] = "tanh"
    """As for `layered`."""
    sensor_positions: Positions | None = None
    """[x, y] of each sensor. Default: by names, or on a line."""
    actuator_positions: Positions | None = None
    """[x, y] of each actuator."""
    threshold: float = Field(default=0.2, ge=0, lt=1)
    """Outputs up to this are no connection."""
    largest_weight: float = Field(default=3.0, gt=0, le=1e6)
    """Largest weight and bias."""
    bias: bool = True
    """Whether biases are computed, too."""
    leo: bool = False
    """Whether link expression outputs, above 0, decide which connections exist."""
    differences: bool = True
    """Whether differences of positions are inputs."""
    length: bool = False
    """Whether the distance is an input."""
    activations: list[PatternFunction] = Field(
        default=["gaussian", "sine", "absolute", "tanh", "linear"], min_length=1, max_length=_FUNCTIONS
    )
    """Functions that new hidden nodes draw; `gaussian` is exp(-a²), `sine` sin(pi a)."""
    max_nodes: int = Field(default=20, ge=0, le=10_000)
    """Largest number of hidden nodes."""
    max_connections: int | None = Field(default=None, ge=1, le=100_000)
    """As for `neat`."""
    weight_range: float = Field(default=1.0, gt=0, le=1e6)
    """As for `neat`."""
    add_node: float = Field(default=0.03, ge=0, le=1)
    """As for `neat`."""
    add_connection: float = Field(default=0.1, ge=0, le=1)
    """As for `neat`."""

    def with_positions(
        self,
        sensors: Sequence[tuple[float, float]] | None,
        actuators: Sequence[tuple[float, float]] | None,
    ) -> Self:
        """Return options with these positions, except for those that are set; None: unknown."""
        described = {"sensor_positions": sensors, "actuator_positions": actuators}
        missing = {
            name: [list(position) for position in positions]
            for name, positions in described.items()
            if positions is not None and getattr(self, name) is None
        }
        return self.model_copy(update=missing) if missing else self


class Hyperneat(GrowingGenomes):
    """Layered networks whose weights are a function of the positions of their nodes.

    A genome is a growing network, see `GrowingNeat`: a compositional pattern-producing network (CPPN). Its
    inputs are the positions of two nodes in successive sheets (sensors, hidden sheets, actuators), and it
    has an output for the weights between each pair of sheets. So nearby nodes have similar weights, and
    symmetries and repetitions of the substrate are found by single genes. What servers evaluate, and what is
    exported, is the layered network, see docs/decisions/031-hyperneat.md.

    Source: Stanley, D'Ambrosio and Gauci, "A hypercube-based encoding for evolving large-scale neural
    networks", Artificial Life 15(2), 2009, with an output for each pair of sheets. Link expression:
    Verbancsics and Stanley, "Constraining connectivity to encourage modularity in HyperNEAT", GECCO 2011.
    """

    kind: ClassVar[str] = "hyperneat"
    options_model = HyperneatOptions
    options: HyperneatOptions

    def __init__(self, options: HyperneatOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when positions do not match the sizes, or a network would be too large."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        for name, count in (("sensor", sensors), ("actuator", actuators)):
            positions = getattr(options, f"{name}_positions")
            if positions is not None and len(positions) != count:
                raise FieldError(
                    ("controller", f"{name}_positions"),
                    f"has {len(positions)} positions for {count} {name}(s); give one for each, or null for "
                    "those of the simulation",
                )
        sizes = [sensors, *(columns * rows for columns, rows in options.hidden), actuators]
        weights = sum(inputs * nodes for inputs, nodes in pairwise(sizes)) + sum(sizes[1:])
        if weights > MOST_WEIGHTS:
            raise FieldError(
                ("controller", "hidden"), f"makes {weights} weights, but at most {MOST_WEIGHTS} are supported"
            )
        self._sizes = sizes
        pairs = len(sizes) - 1
        self._grow(
            (4 + 2 * options.differences + options.length, pairs * (1 + options.bias + options.leo)),
            (options.activations, _FUNCTIONS),
            max_nodes=options.max_nodes,
            max_connections=options.max_connections,
            weight_range=options.weight_range,
            add_node=options.add_node,
            add_connection=options.add_connection,
            pattern=True,
        )

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all layered networks, without weights."""
        return {
            "version": 1,
            "kind": "layered",
            "sensors": self.sensors,
            "actuators": self.actuators,
            "hidden": self._sizes[1:-1],
            "activation": self.options.activation,
            "output_range": list(OUTPUT_RANGE[self.options.activation]),
        }

    @cached_property
    def sheets(self) -> list[NDArray[np.float32]]:
        """Positions of the nodes of each sheet, (nodes, 2): sensors, hidden sheets, actuators."""
        options = self.options
        return [
            _line(self.sensors, options.sensor_positions),
            *(
                np.array([(x, y) for y in _even(rows) for x in _even(columns)], dtype=np.float32)
                for columns, rows in options.hidden
            ),
            _line(self.actuators, options.actuator_positions),
        ]

    @cached_property
    def _points(self) -> NDArray[np.float32]:
        """Inputs of the growing network, (points, inputs): for each pair of sheets biases, then weights.

        The position of the first node of a bias is 0, 0. Weights are in the order of the layered network:
        target after target.
        """
        parts = []
        for sources, targets in pairwise(self.sheets):
            zeros = np.zeros_like(targets)
            parts += [
                np.concatenate([zeros, targets], axis=1),
                np.concatenate(
                    [np.tile(sources, (len(targets), 1)), targets.repeat(len(sources), 0)], axis=1
                ),
            ]
        points = np.concatenate(parts)
        differences = points[:, :2] - points[:, 2:]
        columns = [points]
        if self.options.differences:
            columns.append(differences)
        if self.options.length:
            columns.append(np.sqrt((differences * differences).sum(axis=1, keepdims=True)))
        return np.concatenate(columns, axis=1)

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the weights of the layered networks that genomes encode, (candidates, weights)."""
        count = sum((inputs + 1) * nodes for inputs, nodes in pairwise(self._sizes))
        result = np.empty((len(genomes), count), dtype=np.float32)
        for rows in split_rows(len(genomes), self._points.size):
            result[rows] = self._decode(np.ascontiguousarray(genomes[rows], dtype=np.float32))
        return result

    def _decode(self, genomes: Genomes) -> NDArray[np.float32]:
        options, pairs, number = self.options, len(self._sizes) - 1, len(genomes)
        patterns = self._operators.patterns(genomes, self._points)
        parts, at = [], 0
        for pair, (inputs, nodes) in enumerate(pairwise(self._sizes)):
            points = slice(at + nodes, at + nodes + inputs * nodes)
            weights = self._scale(patterns[:, points, pair])
            if options.leo:
                expressed = patterns[:, points, pairs * (1 + options.bias) + pair] > 0
                weights = np.where(expressed, weights, np.float32(0))
            biases = np.zeros((number, nodes), dtype=np.float32)
            if options.bias:
                biases = self._scale(patterns[:, at : at + nodes, pairs + pair])
            each = np.concatenate([biases[:, :, None], weights.reshape(number, nodes, inputs)], axis=2)
            parts.append(each.reshape(number, -1))
            at = points.stop
        return np.concatenate(parts, axis=1)

    def _scale(self, outputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return weights: 0 up to the threshold, from there on in proportion, in binary32."""
        threshold = np.float32(self.options.threshold)
        factor = np.float32(self.options.largest_weight) / (np.float32(1) - threshold)
        size = np.maximum(np.abs(outputs) - threshold, np.float32(0)) * factor
        return np.copysign(size, outputs) + np.float32(0)


def _even(count: int) -> list[float]:
    """Return coordinates from -1 to 1; 0 for one."""
    return [0.0] if count == 1 else [2 * index / (count - 1) - 1 for index in range(count)]


def _line(count: int, positions: list[list[float]] | None) -> NDArray[np.float32]:
    """Return positions, or a line of nodes if there are none."""
    rows = [[x, 0.0] for x in _even(count)] if positions is None else positions
    return np.array(rows, dtype=np.float32)
