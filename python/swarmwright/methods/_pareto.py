"""The common base of NSGA-II and NSGA-III."""

import hashlib
from abc import abstractmethod
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods import real_variation
from swarmwright.methods._base import DrawStreams, Method, MethodOptions, check_metric_mapping
from swarmwright.methods.archive import Values
from swarmwright.methods.constraints import rank_feasible_first

_ATTEMPTS = 20
"""Attempts to mutate a child into a new genome; there may be few genomes, or no mutations."""


class ParetoOptions(MethodOptions):
    """Options of methods with several objectives."""

    metrics_option = "objectives"
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


class ParetoMethod(Method):
    """Members have children, and the better half of both survives.

    Numbers vary by simulated binary crossover and polynomial mutation, other genes as their representation
    does; a child that equals a member or another child is mutated again. The result is the front of all
    non-dominated evaluations: `swarmwright runs elites RUN`.
    """

    options: ParetoOptions
    steady_state = True
    start_as = "members"
    ranks_violations = True

    def __init__(self, options: ParetoOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._members: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.empty(0)
        self._values: Values = np.empty((0, 1 + len(options.objectives)))

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse numeric variation if genes are choices."""
        invalid = super().problems(options, representation)
        assert isinstance(options, ParetoOptions)
        if options.variation == "sbx" and representation is not None and not representation.continuous:
            invalid["variation"] = (
                f"sbx needs numeric genes, but those of {representation.kind} are choices; use representation"
            )
        return invalid

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members."""
        return self._fitness.copy()

    @property
    def generation_size(self) -> int:
        """Members, and children in each generation."""
        return self.options.population

    @abstractmethod
    def _choose_pairs(self, count: int, streams: DrawStreams) -> NDArray[np.int64]:
        """Return pairs of members that have children, (count, 2)."""

    @abstractmethod
    def _select(self, values: Values) -> list[int]:
        """Return the rows that survive, `population` of them. values: (n, objectives), more is better."""

    @property
    def _is_real(self) -> bool:
        """Whether genes vary as numbers."""
        variation = self.options.variation
        return variation == "sbx" or (variation == "auto" and self.representation.continuous)

    def _ask(self) -> Genomes:
        candidates = np.arange(self.options.population)
        if not len(self._members):
            return self.initials(candidates.tolist())
        return self._vary(candidates, self.streams)

    def _ask_next(self, index: int) -> Genome:
        if index < self.options.population or not len(self._members):
            return self.initial_of(index)
        return np.asarray(self._vary(np.arange(1), self.streams_next(index))[0])

    def _vary(self, candidates: NDArray[np.int64], streams: DrawStreams) -> Genomes:
        """Return children of the members, (n, genome_size), different from these and from each other."""
        children = self._cross(candidates, streams)
        mutants = self._mutate(children, streams(f"{self.kind}.mutate", candidates))
        digests = {_digest(member) for member in self._members}
        rows = candidates
        for attempt in range(_ATTEMPTS):
            rows = np.array([row for row in rows if not _add_digest(digests, mutants[row])], dtype=np.int64)
            if not len(rows):
                break
            mutants[rows] = self._mutate(children[rows], streams(f"{self.kind}.mutate.{attempt}", rows))
        return mutants

    def _cross(self, candidates: NDArray[np.int64], streams: DrawStreams) -> Genomes:
        """Return the children before their mutation; those of a pair are consecutive."""
        pairs = self._choose_pairs((len(candidates) + 1) // 2, streams)
        # The second child of a pair has the same parents in the other order.
        parents = np.stack([pairs, pairs[:, ::-1]], axis=1).reshape(-1, 2)[: len(candidates)]
        children = self._members[parents[:, 0]]
        draws = streams(f"{self.kind}.cross", candidates // 2).units(1)[:, 0]
        crossed = np.flatnonzero(draws < self.options.crossover)
        if not len(crossed):
            return children
        mothers, fathers = children[crossed], self._members[parents[crossed, 1]]
        purpose = f"{self.kind}.crossover"
        children[crossed] = (
            real_variation.cross(
                mothers,
                fathers,
                streams(purpose, crossed // 2),
                self.representation,
                self.options.crossover_index,
                second=crossed % 2 == 1,
            )
            if self._is_real
            else self.representation.crossovers(mothers, fathers, streams(purpose, crossed))
        )
        return children

    def _mutate(self, genomes: Genomes, streams: Streams) -> Genomes:
        options = self.options
        if self._is_real:
            return real_variation.mutate(genomes, streams, self.representation, options.mutation_index)
        return self.representation.mutations(
            genomes, streams, severity=options.severity, probability=options.probability
        )

    def _shuffle(self, count: int, streams: DrawStreams) -> NDArray[np.int64]:
        """Return `count` members in random order, of which all occur equally often, or once less."""
        size = len(self._members)
        shuffles = range(-(-count // size))
        return streams(f"{self.kind}.choose", shuffles).units(size).argsort(axis=1).ravel()[:count]

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - members have no numbers
        self._tell(genome[np.newaxis], np.array([fitness]))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        metrics = self.metrics if self.options.objectives else np.empty((len(genomes), 0))
        members = np.concatenate([self._members, genomes])
        new = self.options.values(fitness, metrics)
        if self.has_constraints:
            # Constrained domination: infeasible candidates are worse in every objective than feasible ones.
            new = rank_feasible_first(new, self.violations[:, np.newaxis])
            fitness = np.where(self.violations > 0, np.nan, fitness)
        values = np.concatenate([self._values, new])
        selected = self._select(values)
        self._members, self._values = members[selected], values[selected]
        self._fitness = np.concatenate([self._fitness, fitness])[selected]


def _digest(genome: Genome) -> bytes:
    return hashlib.sha256(genome.tobytes()).digest()  # genomes can be large


def _add_digest(digests: set[bytes], genome: Genome) -> bool:
    """Add a genome's digest to a set; return whether it is new."""
    digest, count = _digest(genome), len(digests)
    digests.add(digest)
    return len(digests) > count
