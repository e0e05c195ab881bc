"""The networks of NEAT: growing, or those of FREVO's results with fixed or growing connections."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright.common.arrays import Genome
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers._base import Representation, RepresentationOptions
from swarmwright.controllers.kinds.growing.genes import ACTIVATIONS
from swarmwright.controllers.kinds.growing.genomes import MOST_WEIGHTS, GrowingGenomes
from swarmwright.controllers.networks import OUTPUT_RANGE, NodeNetwork

NodeActivation = Literal["steep_sigmoid", "tanh", "sigmoid", "relu", "clamp", "linear"]


class NeatOptions(RepresentationOptions):
    """A network of NEAT: its connections and nodes grow, or `sources` gives them and only weights evolve."""

    kind: Literal["neat"] = "neat"
    max_nodes: int = Field(default=20, ge=0, le=10_000)
    """Growing networks: largest number of hidden nodes."""
    max_connections: int | None = Field(default=None, ge=1, le=100_000)
    """Growing networks: largest number of connections, disabled ones included. Default: those from all
    sensors and the bias to all actuators, and four for each of `max_nodes`.
    """
    recurrent: bool = False
    """Growing networks: whether connections may form cycles. If so, each step computes all nodes once, from
    the outputs of the step before; otherwise each node after its inputs.
    """
    activations: list[NodeActivation] = Field(default=["steep_sigmoid"], min_length=1, max_length=6)
    """Growing networks: activation functions of hidden nodes; each new node draws one. `steep_sigmoid` is the
    sigmoid of 4.924273 times the sum, as in the paper."""
    output_activation: NodeActivation = "steep_sigmoid"
    """Growing networks: activation function of the actuators' nodes. Its range, 0 to 1 or -1 to 1, is mapped
    to the actuators' -1 to 1."""
    add_node: float = Field(default=0.03, ge=0, le=1)
    """Growing networks: probability that a mutation splits a connection by a new node."""
    add_connection: float = Field(default=0.05, ge=0, le=1)
    """Growing networks: probability that a mutation adds a connection."""
    toggle: float = Field(default=0.0, ge=0, le=1)
    """Growing networks: probability that a mutation enables or disables a connection."""
    sources: (
        Annotated[
            list[
                Annotated[
                    list[Annotated[int, Field(ge=0, le=2 * MOST_WEIGHTS)]], Field(max_length=MOST_WEIGHTS)
                ]
            ],
            Field(min_length=1, max_length=MOST_WEIGHTS),
        ]
        | None
    ) = None
    """Fixed connections: the input nodes of each hidden node, then of each actuator: [[0, 3], [0, 1, 2]] is a
    hidden node and an actuator. Sensors have the first numbers, from 0, then hidden nodes, then actuators.
    Default: the network grows.
    """
    frevo: bool = False
    """Whether fixed connections grow, by `max_nodes`, `add_node` and `add_connection`, as in FREVO."""
    iterations: int = Field(default=3, ge=1, le=1000)
    """Fixed connections: how often all nodes are computed in each step, one after the other."""
    weight_range: float = Field(default=1.0, gt=0, le=1e6)
    """Initial weights, and slopes of actuators of fixed networks, are uniform in +-weight_range, also the
    size of a mutation of severity 1. Growing networks: weights stay within eight times this range.
    """
    bias_range: float = Field(default=1.0, gt=0, le=1e6)
    """Fixed connections: initial biases are uniform in +-bias_range, also the size of a mutation of severity
    1."""
    mutation: Literal["uniform", "proportional"] = "uniform"
    """Fixed connections: how a gene is changed: `uniform` within +-severity * range, `proportional` within a
    fifth of its size (at least 0.1), whatever the severity."""

    @model_validator(mode="after")
    def _check_form(self) -> "NeatOptions":
        other: tuple[str, ...] = _FIXED
        reason = "is for fixed connections; give sources, or leave it out"
        if self.frevo:
            other = tuple(name for name in _GROWING if name not in _FREVO)
            reason = "is not an option of FREVO's networks; leave out frevo, or this key"
        elif self.sources is not None:
            other, reason = _GROWING, "is for networks that grow; leave out sources, or this key"
        fields = type(self).model_fields
        for name in other:
            if getattr(self, name) != fields[name].default:
                raise ValueError(f"{name} {reason}")
        return self


_GROWING = (
    "max_nodes", "max_connections", "recurrent", "activations", "output_activation", "add_node",
    "add_connection", "toggle",
)  # fmt: skip
_FIXED = ("iterations", "bias_range", "mutation")
_FREVO = ("max_nodes", "add_node", "add_connection")
"""Options of growing networks that those of FREVO have."""


class Neat(Representation):
    """The networks of NEAT; its instances are `GrowingNeat`, `FrevoNeat` or, with `sources`, `FixedNeat`."""

    kind: ClassVar[str] = "neat"
    options_model = NeatOptions
    options: NeatOptions

    def __new__(cls, options: NeatOptions, **sizes: int) -> Self:  # noqa: ARG004 - for the constructor
        """Choose the form."""
        fixed: type[Any] = GrowingNeat if options.sources is None else FixedNeat
        form: type[Any] = FrevoNeat if options.frevo else fixed
        return super().__new__(form if cls is Neat else cls)


class GrowingNeat(GrowingGenomes, Neat):
    """Networks whose nodes and connections grow, after Stanley and Miikkulainen.

    A genome has genes for as many nodes and connections as there may be, see
    docs/decisions/030-networks-that-grow.md. Networks start with connections from every sensor and a bias,
    whose output is 1, to every actuator. A mutation of weights moves each with the given probability, uniform
    in +-severity * weight_range, from its value or, one time in ten, from 0. Unless that
    probability is 0, mutations also add nodes and connections, with the probabilities of the options.

    The innovation number of a connection is the pair of its nodes, that of a node a hash of the connection
    that it splits. So the same innovation has the same number in all genomes of all runs, whatever the order
    of evaluations. A crossover takes weights of matching connections from either parent, and all else from
    the mother. The distance is that of the paper, with the coefficients 1, 1 and 0.4.

    Source: Stanley and Miikkulainen, "Evolving neural networks through augmenting topologies", Evolutionary
    Computation 10(2), 2002.
    """

    def __init__(self, options: NeatOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when `max_connections` is too small, or the genome too large."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        self._grow(
            (sensors, actuators),
            (options.activations, len(ACTIVATIONS)),
            max_nodes=options.max_nodes,
            max_connections=options.max_connections,
            weight_range=options.weight_range,
            add_node=options.add_node,
            add_connection=options.add_connection,
            toggle=options.toggle,
            recurrent=options.recurrent,
        )

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        output = self.options.output_activation
        return {
            "version": 1,
            "kind": "growing",
            "sensors": self.sensors,
            "actuators": self.actuators,
            "nodes": self.options.max_nodes,
            "connections": self._connections,
            "recurrent": self.options.recurrent,
            "output_activation": output,
            "output_range": list(OUTPUT_RANGE[output]),
        }


class FixedNeat(NodeNetwork, Neat):
    """The networks of FREVO's NEAT with a fixed list of connections.

    Genes: node after node (hidden, then outputs): the bias, a weight for each input node, and for an output
    the slope of its sigmoid. Hidden nodes are the tanh of their sum. All nodes are computed in order, from
    the current values of the others, and keep their values from step to step. Outputs in 0..1 are mapped to
    actuators in -1..1.

    Operators are those of the other networks; a slope is a weight. FREVO itself only adds connections and
    nodes: its mutations of weights, biases and slopes change copies that are not used.
    """

    options: NeatOptions  # type: ignore[assignment] # has the options that the operators use

    def __init__(self, options: NeatOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when `sources` does not match the numbers of sensors and actuators."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        rows = self.initial_sources
        if len(rows) < actuators:
            raise FieldError(
                ("controller", "sources"),
                f"{len(rows)} lists for {actuators} actuators; give a list for each hidden node and each "
                "actuator",
            )
        nodes = sensors + len(rows)
        for row, inputs in enumerate(rows):
            missing = [source for source in inputs if source >= nodes]
            if missing:
                raise FieldError(
                    ("controller", "sources", row),
                    f"node {missing[0]} does not exist; with {sensors} sensors the last node is {nodes - 1}",
                )
        if self.genome_size > MOST_WEIGHTS:
            raise FieldError(
                ("controller", "sources"),
                f"{self.genome_size} weights, but at most {MOST_WEIGHTS} are supported",
            )

    @property
    def initial_sources(self) -> list[list[int]]:
        """`sources` of the options."""
        return self.options.sources or []

    @property
    def sources(self) -> list[list[int]]:
        """Input nodes of each node, hidden nodes first."""
        return self.initial_sources

    def node_sizes(self) -> Sequence[int]:
        """Return the number of inputs of each node, plus one for the slope of an output."""
        rows = self.sources
        hidden = len(rows) - self.actuators
        return [len(row) + (node >= hidden) for node, row in enumerate(rows)]

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "sources": self.sources,
            "iterations": self.options.iterations,
        }


class FrevoNeat(FixedNeat):
    """The networks of FREVO's NEAT, whose connections and nodes grow.

    A genome has genes for connections between all nodes, of which there are `max_nodes` hidden ones; a
    connection of weight 0 does not exist. Each node adds its inputs in the order of `sources`, then all
    others in the order of nodes, so that FREVO's networks have the same outputs, to the bit.

    As in FREVO, a mutation splits a connection by a new node, or else adds a connection, or else changes
    numbers, here those of all nodes and connections that exist. The node that splits a connection is the
    same in all genomes, unless it is occupied. A crossover takes numbers that both parents have from
    either, and all else from the mother. The distance is that of fixed networks.
    """

    continuous = False

    def __init__(self, options: NeatOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when `sources` does not match the numbers of sensors, actuators and nodes."""
        hidden = len(options.sources or []) - actuators
        if hidden > options.max_nodes:
            raise FieldError(
                ("controller", "max_nodes"),
                f"is {options.max_nodes}, but sources has {hidden} hidden nodes; use at least {hidden}",
            )
        super().__init__(options, sensors=sensors, actuators=actuators)

    @property
    def initial_sources(self) -> list[list[int]]:
        """`sources` of the options, or all sensors for each actuator."""
        return self.options.sources or [list(range(self.sensors))] * self.actuators

    @cached_property
    def sources(self) -> list[list[int]]:
        """Input nodes of each node, those that do not exist yet included."""
        rows = self.initial_sources
        hidden, most = len(rows) - self.actuators, self.options.max_nodes
        first, last = self.sensors + hidden, range(self.sensors + most + self.actuators)
        shifted = [[source + (source >= first) * (most - hidden) for source in row] for row in rows]
        shifted[hidden:hidden] = [[]] * (most - hidden)
        return [[*row, *(source for source in last if source not in set(row))] for row in shifted]

    @cached_property
    def _connections(self) -> NDArray[np.int64]:
        """(connections, 3): the gene, the source, and the target of each."""
        return np.array(
            [
                (self._starts[node] + 1 + index, source, self.sensors + node)
                for node, row in enumerate(self.sources)
                for index, source in enumerate(row)
            ],
            dtype=np.int64,
        )

    @cached_property
    def _initial_genes(self) -> NDArray[np.bool_]:
        """Whether a network has each gene at the start."""
        rows = self.initial_sources
        hidden, spare = len(rows) - self.actuators, self.options.max_nodes + self.actuators - len(rows)
        counts = [len(row) for row in rows]
        counts[hidden:hidden] = [0] * spare
        present = np.zeros(self.genome_size, dtype=np.bool_)
        for start, count in zip(self._starts[:-1], counts, strict=True):
            present[start + 1 : start + 1 + count] = True
        for node in range(hidden):
            present[self._starts[node]] = True
        return present | self._of_actuators

    @cached_property
    def _of_actuators(self) -> NDArray[np.bool_]:
        """The genes of all networks: biases and slopes of actuators."""
        genes = np.zeros(self.genome_size, dtype=np.bool_)
        genes[self._starts[self.options.max_nodes : -1]] = True
        genes[self._starts[self.options.max_nodes + 1 :] - 1] = True
        return genes

    def _nodes(self, genome: Genome) -> NDArray[np.bool_]:
        """Return whether each node, sensors first, is in a network: hidden ones if they are connected."""
        nodes = np.ones(self.sensors + len(self.sources), dtype=np.bool_)
        nodes[self.sensors : self.sensors + self.options.max_nodes] = False
        genes = self._connections
        nodes[genes[genome[genes[:, 0]] != 0, 1:]] = True
        return nodes

    def initial(self, stream: Stream) -> Genome:
        """Return a network with the connections of `sources` and random numbers."""
        return np.where(self._initial_genes, super().initial(stream), np.float32(0))

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy with a new node or connection, or other numbers, see the class."""
        child = genome.copy()
        if probability == 0:
            return child
        node, connection = stream.unit(2)
        if node < self.options.add_node and self._split(child, stream):
            return child
        if connection < self.options.add_connection and self._connect(child, stream):
            return child
        changed = super().mutate(genome, stream, severity=severity, probability=probability)
        exists = (genome != 0) | self._of_actuators
        exists[self._starts[: self.options.max_nodes]] = self._nodes(genome)[
            self.sensors : self.sensors + self.options.max_nodes
        ]
        return np.where(exists, changed, genome)

    def _split(self, genome: Genome, stream: Stream) -> bool:
        """Split a connection by a hidden node that does not exist yet; False if there is none."""
        most, genes = self.options.max_nodes, self._connections
        existing = genes[genome[genes[:, 0]] != 0]
        occupied = self._nodes(genome)[self.sensors : self.sensors + most]
        if not len(existing) or occupied.all():
            return False
        gene, source, target = existing[stream.integer(len(existing))].tolist()
        preferred = source * (self.sensors + len(self.sources)) + target
        new = next(node for offset in range(most) if not occupied[node := (preferred + offset) % most])
        genome[self._starts[new]] = 0
        genome[self._gene(self.sensors + new, target)] = genome[gene]
        genome[self._gene(source, self.sensors + new)] = 1
        genome[gene] = 0
        return True

    def _connect(self, genome: Genome, stream: Stream) -> bool:
        """Add a connection between nodes that exist; False if there are all."""
        genes, nodes = self._connections, self._nodes(genome)
        missing = genes[(genome[genes[:, 0]] == 0) & nodes[genes[:, 1]] & nodes[genes[:, 2]], 0]
        if not len(missing):
            return False
        gene = missing[stream.integer(len(missing))]
        genome[gene] = stream.uniform(np.array([self.options.weight_range]))[0]
        return True

    def _gene(self, source: int, target: int) -> int:
        """Return the gene of a connection."""
        node = target - self.sensors
        return int(self._starts[node]) + 1 + self.sources[node].index(source)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with numbers of `father` that both have."""
        from_father = stream.unit(self.genome_size) < 0.5
        return np.where(from_father & (mother != 0) & (father != 0), father, mother)

    def adopt(self, architecture: Mapping[str, Any], weights: NDArray[np.float32]) -> Genome | None:
        """Return the genome of a network of FREVO's NEAT; None if its connections are in another order."""
        own, rows = self.architecture(), architecture.get("sources", [])
        hidden, most = len(rows) - self.actuators, self.options.max_nodes
        same_shape = all(architecture.get(key) == own[key] for key in own if key != "sources")
        if not same_shape or not 0 <= hidden <= most:
            return None
        genome, at = np.zeros(self.genome_size, dtype=np.float32), 0
        for node, row in enumerate(rows):
            rank = node if node < hidden else node + most - hidden
            start, position = int(self._starts[rank]), 0
            genome[start] = weights[at]
            for index, source in enumerate(row, 1):
                renumbered = source + (source >= self.sensors + hidden) * (most - hidden)
                if renumbered not in self.sources[rank][position:]:
                    return None
                position = self.sources[rank].index(renumbered, position) + 1
                genome[start + position] = weights[at + index]
            at += 1 + len(row)
            if node >= hidden:
                genome[self._starts[rank + 1] - 1] = weights[at]
                at += 1
        return genome
