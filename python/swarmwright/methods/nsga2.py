"""NSGA-II: multi-objective optimization."""

import hashlib
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods import real_variation
from swarmwright.methods._base import Method, MethodOptions, check_metric_mapping
from swarmwright.methods.archive import Values, crowding, ranks

_ATTEMPTS = 20
"""Attempts to mutate a child into a new genome; there may be few genomes, or no mutations."""


class Nsga2Options(MethodOptions):
    """Multi-objective: trade-offs between fitness and further metrics."""

    metrics_option = "objectives"
    kind: Literal["nsga2"] = "nsga2"
    population: int = Field(default=100, ge=4, le=4_000)
    """Members, and children in each generation."""
    objectives: dict[str, Literal["maximize", "minimize"]] = Field(default={}, max_length=8)
    """Metrics to optimize besides the fitness, as means over episodes: `{energy: minimize}`. Required in
    experiments."""
    crossover: float = Field(default=0.9, ge=0, le=1)
    """Probability of a child of two members, which is then mutated; other children are mutated copies."""
    variation: Literal["auto", "sbx", "representation"] = "auto"
    """sbx: simulated binary crossover and polynomial mutation. representation: the operators of the
    controller's representation. auto: sbx for numeric genes, else representation."""
    crossover_index: float = Field(default=15, ge=0, le=1000)
    """sbx: distribution index of crossovers; the larger, the closer children are to their parents."""
    mutation_index: float = Field(default=20, ge=0, le=1000)
    """sbx: distribution index of mutations; the larger, the smaller they are."""
    severity: float = Field(default=0.2, ge=0, le=1000)
    """representation: size of mutations, relative to the initial range of weights and biases."""
    probability: float = Field(default=0.2, ge=0, le=1)
    """representation: probability that a mutation changes a gene."""

    @field_validator("objectives", mode="before")
    @classmethod
    def _check_objectives(cls, value: object) -> object:
        return check_metric_mapping(value, "a direction", "energy", "minimize")

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the metrics that are objectives."""
        return tuple(self.objectives)

    def values(self, fitness: Fitness, metrics: Values) -> Values:
        """Return the values to maximize, (n, 1 + objectives), of fitness (n,) and metrics (n, objectives)."""
        signs = [1.0 if goal == "maximize" else -1.0 for goal in self.objectives.values()]
        return np.column_stack([fitness, metrics * np.array(signs)])


class Nsga2(Method):
    """NSGA-II, which sorts members and children by non-dominated fronts, and within a front by isolation.

    Parents win a tournament of two by front, then by isolation. Numbers vary by simulated binary crossover
    and polynomial mutation, other genes as their representation does; a child that equals a member or another
    child is mutated again. The result is the front of all non-dominated evaluations:
    `swarmwright runs elites RUN`.

    Source: Deb, Pratap, Agarwal and Meyarivan, "A fast and elitist multiobjective genetic algorithm:
    NSGA-II", IEEE Transactions on Evolutionary Computation 6(2), 2002.
    """

    kind: ClassVar[str] = "nsga2"
    options_model = Nsga2Options
    options: Nsga2Options
    start_as = "members"

    def __init__(self, options: Nsga2Options, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._members: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.empty(0)
        self._values: Values = np.empty((0, 1 + len(options.objectives)))
        self._ranks: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._crowding: Values = np.empty(0)

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse numeric variation if genes are choices."""
        invalid = super().problems(options, representation)
        assert isinstance(options, Nsga2Options)
        if options.variation == "sbx" and representation is not None and not representation.continuous:
            invalid["variation"] = (
                f"sbx needs numeric genes, but those of {representation.kind} are choices; use representation"
            )
        return invalid

    @property
    def _is_real(self) -> bool:
        """Whether genes vary as numbers."""
        variation = self.options.variation
        return variation == "sbx" or (variation == "auto" and self.representation.continuous)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members."""
        return self._fitness.copy()

    def _ask(self) -> Genomes:
        options = self.options
        candidates = np.arange(options.population)
        if not len(self._members):
            return self.initials(candidates.tolist())
        parents = self._run_tournaments(
            self.streams("nsga2.choose", candidates).integers(len(self._members), 4)
        )
        children = self._members[parents[:, 0]]
        crossed = np.flatnonzero(self.streams("nsga2.cross", candidates).units(1)[:, 0] < options.crossover)
        if len(crossed):
            pairs = children[crossed], self._members[parents[crossed, 1]]
            streams = self.streams("nsga2.crossover", crossed)
            children[crossed] = (
                real_variation.cross(*pairs, streams, self.representation, options.crossover_index)
                if self._is_real
                else self.representation.crossovers(*pairs, streams)
            )
        mutants = self._mutate(children, self.streams("nsga2.mutate", candidates))
        digests = {_digest(member) for member in self._members}
        rows = candidates
        for attempt in range(_ATTEMPTS):
            rows = np.array([row for row in rows if not _add_digest(digests, mutants[row])], dtype=np.int64)
            if not len(rows):
                break
            mutants[rows] = self._mutate(children[rows], self.streams(f"nsga2.mutate.{attempt}", rows))
        return mutants

    def _mutate(self, genomes: Genomes, streams: Streams) -> Genomes:
        options = self.options
        if self._is_real:
            return real_variation.mutate(genomes, streams, self.representation, options.mutation_index)
        return self.representation.mutations(
            genomes, streams, severity=options.severity, probability=options.probability
        )

    def _run_tournaments(self, drawn: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the winners of pairs: (n, 4) members to (n, 2)."""
        first, second = drawn[:, 0::2], drawn[:, 1::2]
        better = self._ranks[second] < self._ranks[first]
        isolated = (self._ranks[second] == self._ranks[first]) & (
            self._crowding[second] > self._crowding[first]
        )
        return np.where(better | isolated, second, first)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        metrics = self.metrics if self.options.objectives else np.empty((len(genomes), 0))
        members = np.concatenate([self._members, genomes])
        values = np.concatenate([self._values, self.options.values(fitness, metrics)])
        all_fitness = np.concatenate([self._fitness, fitness])
        fronts = ranks(values)
        selected: list[int] = []
        distances = np.zeros(len(values))
        for front in range(int(fronts.max()) + 1):
            rows = np.flatnonzero(fronts == front)
            distances[rows] = crowding(np.where(np.isfinite(values[rows]), values[rows], 0.0))
            free = self.options.population - len(selected)
            if len(rows) > free:
                rows = np.sort(rows[np.argsort(-distances[rows], kind="stable")[:free]])
            selected.extend(rows.tolist())
            if len(selected) == self.options.population:
                break
        self._members, self._values, self._fitness = (
            members[selected],
            values[selected],
            all_fitness[selected],
        )
        self._ranks, self._crowding = fronts[selected], distances[selected]


def _digest(genome: Genome) -> bytes:
    return hashlib.sha256(genome.tobytes()).digest()  # genomes can be large


def _add_digest(digests: set[bytes], genome: Genome) -> bool:
    """Add a genome's digest to a set; return whether it is new."""
    digest, count = _digest(genome), len(digests)
    digests.add(digest)
    return len(digests) > count
