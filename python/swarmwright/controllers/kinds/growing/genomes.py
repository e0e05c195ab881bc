"""Genomes of networks that grow, and their operators."""

from collections.abc import Sequence

import numpy as np

from swarmwright import _engine
from swarmwright.common.arrays import Genome, Limits
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers._base import Representation

MOST_WEIGHTS = 1_000_000
"""Largest number of weights of a network."""
_MOST_RANGES = 8.0
"""Largest weight of a growing network, as a multiple of the initial range; as the engine has it."""
_LAST_MARKING = (1 << 24) - 1
"""Largest innovation number of a node."""


class GrowingGenomes(Representation):
    """Representations with genes for as many nodes and connections as there may be.

    The constructor of a subclass calls `_grow`. See docs/decisions/030-networks-that-grow.md.
    """

    continuous = False

    def _grow(
        self,
        ends: tuple[int, int],
        functions: tuple[Sequence[str], int],
        *,
        max_nodes: int,
        max_connections: int | None,
        weight_range: float,
        add_node: float,
        add_connection: float,
        toggle: float = 0.0,
        recurrent: bool = False,
        pattern: bool = False,
    ) -> None:
        """Create the operators.

        ends: numbers of inputs and outputs. functions: activation functions of hidden nodes, and how many
        there are in all. pattern: whether networks are functions of space. Others: see the options.

        Raises InputError when `max_connections` is too small, or the genome too large.
        """
        inputs, outputs = ends
        least = (inputs + 1) * outputs
        connections = least + 4 * max_nodes if max_connections is None else max_connections
        if connections < least:
            raise FieldError(
                ("controller", "max_connections"),
                f"is {connections}, but networks start with {least} connections from {inputs} "
                f"{'coordinates' if pattern else 'sensors'} and the bias to {outputs} "
                f"{'output' if pattern else 'actuator'}(s)",
            )
        self._operators = _engine.GrowingNetwork(
            sensors=inputs,
            actuators=outputs,
            nodes=max_nodes,
            connections=connections,
            recurrent=recurrent,
            activations=functions[0],
            weight_range=weight_range,
            add_node=add_node,
            add_connection=add_connection,
            toggle=toggle,
            pattern=pattern,
        )
        self._connections, self._weight_range = connections, weight_range
        last = inputs + outputs + max_nodes
        counts = [max(max_nodes, 1), *[connections] * outputs]
        nodes = [_LAST_MARKING, functions[1] - 1, connections] * max_nodes
        self._highest = np.array([*counts, *nodes, *[last, 0.0, 1.0] * connections], dtype=np.float64)
        if self.genome_size > MOST_WEIGHTS:
            raise FieldError(
                ("controller", "max_connections"),
                f"makes {self.genome_size} genes, but at most {MOST_WEIGHTS} are supported",
            )

    @property
    def genome_size(self) -> int:
        """Number of genes, those included that are not in use."""
        return self._operators.genes

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene."""
        return self._limits(_MOST_RANGES * self._weight_range)

    @property
    def initial_range(self) -> Limits:
        """The bounds, but for weights their initial range."""
        return self._limits(self._weight_range)

    def _limits(self, weight: float) -> Limits:
        """Return the limits of all genes; weight: limit of a weight."""
        low, high = np.zeros(self.genome_size), self._highest.copy()
        weights = slice(self.genome_size - 3 * self._connections + 1, None, 3)
        low[weights], high[weights] = -np.float32(weight), np.float32(weight)
        return low, high

    @property
    def operators(self) -> _engine.GrowingNetwork | None:
        """The engine's operators; None if a subclass overrides them."""
        names = ("initial", "initials", "mutate", "mutations", "crossover", "matings", "distance")
        inherited = all(getattr(type(self), name) is getattr(GrowingGenomes, name) for name in names)
        return self._operators if inherited else None

    def initial(self, stream: Stream) -> Genome:
        """Return a network in which all inputs and the bias are connected with all outputs."""
        return self._operators.initial(stream)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy with a new node or connection, or changed weights, see `GrowingNeat`."""
        return self._operators.mutate(genome, stream, severity=severity, probability=probability)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with weights of `father`."""
        return self._operators.crossover(mother, father, stream)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the compatibility distance."""
        return self._operators.distance(genome, other)
