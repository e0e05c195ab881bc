"""The base class of representations."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genome, Genomes, Limits, shortest
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.problems import format_value
from swarmwright.common.random_numbers import Stream, Streams

LARGEST_GENOME = 1_000_000
"""Upper limit of genes of a controller, as in the engine."""
MANY = 1 << 22
"""Largest number of float64 values drawn at once; they take 32 MB."""
_DRAWS = 16
"""How often a number beyond its bounds is redrawn before it is clipped."""
FEW = 1 << 15
"""Size of the arrays used in one computation, in numbers; they fit into the processor's caches."""

_DERIVED_OPERATORS = {
    "initial": {"initials"},
    "mutate": {"mutations", "perturbations"},
    "crossover": {"crossovers", "matings"},
    "crossovers": {"matings"},
    "distance": {"distances", "distances_among", "matings"},
    "distances": {"distances_among", "matings"},
    "distances_among": {"matings"},
}
"""Operators whose default implementation calls the key."""


class RepresentationOptions(Options):
    """Options of every representation."""

    kind: str = ""
    """Name of the representation."""


class Representation(ABC):
    """A genome is a flat row of float32 numbers; a representation decodes it to a controller.

    It gives genomes their meaning (`architecture` and `weights`, what the engine and every simulation server
    understand) and its genetic operators: where evolution starts (`initial`), how a genome varies (`mutate`),
    how two are combined (`crossover`) and how different two are (`distance`). Methods use genomes only
    through these, so any method can evolve any representation. Operators are pure: they return new arrays and
    take their randomness from the stream they are given.

    Each operator has a batch form (`initials`, `mutations`, `crossovers`, `distances_among`, `matings`),
    which methods call. By default it is a loop; a representation may override it with a faster implementation
    that returns the same bits. A subclass that overrides an operator but not its batch form gets the loop
    back.

    Args:
        options: this representation's section of the experiment.
        sensors: sensor values of an agent in each step, at least 1.
        actuators: actuator values of an agent in each step, at least 1.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[RepresentationOptions]]
    """Typed options, with `kind` among them."""
    continuous: ClassVar[bool] = True
    """Whether genes are numbers to compute with: any value within `bounds` is a gene, and a small step makes
    a similar controller. False for genes that are choices, such as the entries of a table: methods that add
    and scale genes refuse such a representation."""

    shape: ClassVar[tuple[int, int] | None] = None
    """(sensors, actuators) of its controllers; the constructor raises InputError for other numbers. None:
    any."""
    steers: ClassVar[bool] = True
    """Whether its controllers steer agents. False for parameters that the simulation gets before an episode;
    these fit any numbers of sensors and actuators."""

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        self.options = options
        self.sensors = sensors
        self.actuators = actuators

    def __repr__(self) -> str:
        """Name the class and the sizes."""
        return f"<{type(self).__name__}: {self.sensors} sensors, {self.actuators} actuators>"

    def __init_subclass__(cls, **options: Any) -> None:  # noqa: ANN401 - those of other base classes
        """Reset the batch forms of operators that a subclass overrides."""
        super().__init_subclass__(**options)
        defined = set(vars(cls))
        for operator, forms in _DERIVED_OPERATORS.items():
            if operator in defined:
                for form in forms - defined:
                    setattr(cls, form, getattr(Representation, form))

    @classmethod
    def options_of(cls, architecture: Mapping[str, Any]) -> dict[str, Any]:
        """Return options for controllers with an architecture; by default those that it names.

        architecture: as `architecture` returns it.
        """
        return {key: value for key, value in architecture.items() if key in cls.options_model.model_fields}

    @property
    @abstractmethod
    def genome_size(self) -> int:
        """Number of genes."""

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene, float32 numbers; -inf and inf if it is unbounded.

        Default: unbounded. `initial`, `mutate` and `crossover` respect the bounds, and so does every method.
        """
        return np.full(self.genome_size, -np.inf), np.full(self.genome_size, np.inf)

    @property
    def initial_range(self) -> Limits:
        """Range of each gene of `initial`: finite, within `bounds`, lower < upper.

        Methods that need a center and a step size derive them from it. Default: the bounds; -1 to 1 for a
        gene without bounds.
        """
        lower, upper = self.bounds
        bounded = np.isfinite(lower) & np.isfinite(upper)
        return np.where(bounded, lower, -1.0), np.where(bounded, upper, 1.0)

    @property
    def gene_names(self) -> tuple[str, ...]:
        """A name for each gene, for people; empty (the default) if genes have none."""
        return ()

    @abstractmethod
    def architecture(self) -> dict[str, Any]:
        """Return the part of the specification that all controllers share: everything but the weights.

        See protocol/schemas/controller.schema.json.
        """

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the weights of the controllers that genomes encode.

        Args:
            genomes: (candidates, genome_size).

        Returns:
            (candidates, weights) float32, finite. Default: the genes are the weights.
        """
        return genomes

    def specification(self, genome: Genome) -> dict[str, Any]:
        """Return one controller as plain values.

        Args:
            genome: (genome_size,), finite.

        Raises InputError when the genome is something else.
        """
        try:
            row = np.asarray(genome, dtype=np.float32)
        except (TypeError, ValueError):
            raise InputError(
                f"genome: is {format_value(genome)}; expected {self.genome_size} numbers"
            ) from None
        if row.shape != (self.genome_size,):
            raise InputError(f"genome: has the shape {row.shape}; expected ({self.genome_size},)")
        if not np.isfinite(row).all():
            raise InputError("genome: has a number that is not finite; expected finite numbers")
        return {**self.architecture(), "weights": shortest(self.weights(row[np.newaxis])[0])}

    def adopt(
        self,
        architecture: Mapping[str, Any],  # noqa: ARG002 - for subclasses
        weights: NDArray[np.float32],  # noqa: ARG002
    ) -> Genome | None:
        """Return the genome of a controller with another architecture; None (the default) if there is none.

        Args:
            architecture: as `architecture` returns it, of a valid controller.
            weights: its weights.
        """
        return None

    @property
    def operators(self) -> _engine.NodeNetwork | _engine.GrowingNetwork | None:
        """The operators, if the engine implements them; None (the default) if only Python does."""
        return None

    @property
    def start_genome(self) -> Genome | None:
        """The genome that the options name as the start of the evolution; None without one."""
        return None

    @abstractmethod
    def initial(self, stream: Stream) -> Genome:
        """Return a random genome to start from."""

    @abstractmethod
    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is changed with `probability`; `severity` scales the change.

        Args:
            genome: (genome_size,) float32; it is not changed.
            stream: stream of random numbers, the only source of randomness.
            severity: size of the changes, at least 0, in units that the representation describes.
            probability: probability of a change of each gene, 0 to 1.
        """

    @abstractmethod
    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a part of `father`.

        Args:
            mother: (genome_size,) float32; neither parent is changed.
            father: the same.
            stream: stream of random numbers, the only source of randomness.
        """

    @abstractmethod
    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the distance between two genomes, (genome_size,) each.

        It is finite, at least 0, 0 for equal ones, and the same for both orders.
        """

    def distances(self, genome: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        distances: Any = [self.distance(genome, other) for other in others]
        if is_plug_in(type(self)):
            distances = numbers(
                self, "distance", distances, (len(others),), "distances", some=False, dtype=np.float64
            )
        return np.array(distances, dtype=np.float64)

    def initials(self, streams: Streams) -> Genomes:
        """Return a random genome for each stream, (n, genome_size)."""
        return self._rows("initial", [self.initial(stream) for stream in streams])

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each of n parents, (n, genome_size), with the stream of the same index.

        severity, probability: as in `mutate`.

        Streams may have been used before; each continues at its position and is used up afterwards.
        """
        return self._rows(
            "mutate",
            [
                self.mutate(parent, stream, severity=severity, probability=probability)
                for parent, stream in zip(parents, streams, strict=True)
            ],
        )

    def perturbations(
        self,
        parents: Genomes,
        streams: Streams,
        *,
        spread: NDArray[np.float64],
        fresh: NDArray[np.float64],
    ) -> Genomes:
        """Return a genome around each of n parents, as iterated racing samples them.

        By default numbers come from a normal distribution around the parent's, within `bounds`. Genes that
        are choices are mutated with the probability `fresh` and the severity `spread`.

        Args:
            parents: (n, genome_size).
            streams: one for each parent.
            spread: (n,), 0 to 1: the standard deviation of numbers, as a share of half of `initial_range`.
            fresh: (n,), 0 to 1: the probability with which a choice is drawn anew.
        """
        if self.continuous:
            low, high = self.initial_range
            return sample_around(parents, streams, spread[:, np.newaxis] * (high / 2 - low / 2), self.bounds)
        rows = zip(parents, streams, spread.tolist(), fresh.tolist(), strict=True)
        return self._rows(
            "mutate",
            [
                self.mutate(parent, stream, severity=severity, probability=probability)
                for parent, stream, severity, probability in rows
            ],
        )

    def likeness(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return features for comparing genomes: equal controllers have equal features.

        Args:
            genomes: (n, genome_size).

        Returns:
            (n, numbers). By default genes, in units of their initial range where they are numbers.
        """
        low, high = self.initial_range
        return genomes.astype(np.float64) / ((high - low) if self.continuous else 1.0)

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a child of each of n pairs, made with the stream of the same index; see `mutations`.

        mothers, fathers: (n, genome_size) each.
        """
        pairs = zip(mothers, fathers, streams, strict=True)
        children = [self.crossover(mother, father, stream) for mother, father, stream in pairs]
        return self._rows("crossover", children)

    def matings(
        self, genomes: Genomes, mothers: NDArray[np.int64], partners: NDArray[np.int64], streams: Streams
    ) -> Genomes:
        """Return a child of each of n mothers and its most distant partner, see `crossovers`.

        On a tie, the first of the partners is the father.

        Args:
            genomes: (m, genome_size).
            mothers: (n,), indices 0 to m - 1.
            partners: (n, k), indices 0 to m - 1, k >= 1.
            streams: one for each mother.
        """
        distances = self.distances_among(genomes, mothers, partners)
        fathers = partners[np.arange(len(partners)), distances.argmax(axis=1)]
        return self.crossovers(genomes[mothers], genomes[fathers], streams)

    def distances_among(
        self, genomes: Genomes, indices: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances between genomes, given by their indices.

        Args:
            genomes: (m, genome_size).
            indices: (n,), indices 0 to m - 1.
            others: (n, k), indices 0 to m - 1.

        Returns:
            (n, k), the distance of each of `indices` to each in its row of `others`.
        """
        rows = [
            self.distances(genomes[index], genomes[row]) for index, row in zip(indices, others, strict=True)
        ]
        return np.array(rows, dtype=np.float64).reshape(others.shape)

    def _rows(self, operator: str, genomes: list[Genome]) -> Genomes:
        """Return the results of a single-genome operator as an array, checked for plug-ins."""
        if is_plug_in(type(self)):
            size = (self.genome_size,)
            genomes = [
                numbers(self, operator, genome, size, "a genome, (genome_size,)") for genome in genomes
            ]
        return np.array(genomes, dtype=np.float32).reshape(len(genomes), self.genome_size)


def sample_around(
    centers: Genomes, streams: Streams, deviations: NDArray[np.float64], bounds: Limits
) -> Genomes:
    """Sample normal distributions; numbers beyond the bounds are redrawn.

    Args:
        centers: (n, numbers), within the bounds.
        streams: one for each row.
        deviations: standard deviations, (n, numbers).
        bounds: lowest and highest values, (numbers,) each.
    """
    (lower, upper), means = bounds, centers.astype(np.float64)
    samples = means + deviations * streams.normals(centers.shape[1])
    for _ in range(_DRAWS):
        beyond = (samples < lower) | (samples > upper)
        if not beyond.any():
            break
        samples = np.where(beyond, means + deviations * streams.normals(centers.shape[1]), samples)
    return np.clip(samples, lower, upper).astype(np.float32)


def split_rows(count: int, each: int) -> list[slice]:
    """Return slices of `count` rows of `each` numbers, small enough for the caches."""
    step = max(1, FEW // max(each, 1))
    return [slice(first, first + step) for first in range(0, count, step)]
