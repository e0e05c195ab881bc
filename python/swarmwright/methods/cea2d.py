"""CEA2D: FREVO's cellular evolutionary algorithm, a population on a torus."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions


class Cea2dOptions(MethodOptions):
    """FREVO's CEA2D: members on a torus interact only with their neighbours. The four shares sum to 1."""

    kind: Literal["cea2d"] = "cea2d"
    width: int = Field(default=10, ge=2, le=3000)
    """Columns of the torus."""
    height: int = Field(default=10, ge=2, le=3000)
    """Rows of the torus; width x height is the population."""
    neighbourhood: Literal["grid", "random"] = "grid"
    """grid: the 8 surrounding cells. random: 8 random cells, drawn once."""
    obstacles: int = Field(default=0, ge=0)
    """Number of random empty cells, which separate regions."""
    elite: float = Field(default=0.11, ge=0, le=1)
    """Share of a neighbourhood, including the cell itself, that survives; by default the best of 9 cells."""
    mutate: float = Field(default=0.59, ge=0, le=1)
    """Share of mutated copies of an elite neighbour."""
    crossover: float = Field(default=0.30, ge=0, le=1)
    """Share of children of the cell's member and an elite neighbour."""
    renew: float = Field(default=0.0, ge=0, le=1)
    """Share of new random members."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """Size of mutations, relative to the initial range of weights and biases."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability that a mutation changes a gene."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        total = math.fsum([self.elite, self.mutate, self.crossover, self.renew])
        if abs(total - 1) > 1e-6:
            raise ValueError(f"elite, mutate, crossover and renew must add up to 1, not {total:.6g}")
        if self.elite > 0.9:
            raise ValueError(
                f"elite must be at most 0.9, not {self.elite:.6g}, else no new candidates are created"
            )
        if self.members < 2:
            raise ValueError(f"obstacles must leave at least 2 of {self.width * self.height} cells free")
        return self

    @property
    def members(self) -> int:
        """Cells that are not obstacles."""
        return self.width * self.height - self.obstacles


class Cea2d(Method):
    """A cellular algorithm: members compete and mate only with neighbours, so good genes spread slowly.

    A member among the best of its neighbourhood survives with its fitness. Every other cell receives a
    mutated copy of an elite neighbour, a child of its member and an elite neighbour, or a random member. All
    cells change at once, and only new members are evaluated. In steady state, cells change one after another,
    column by column, and cells with surviving members are skipped.

    Source: CEA2D of FREVO (Dittrich, Zhevzhyk; Components/Methods/CEA2D), with four differences. Of equal
    members the one in the later cell ranks first, as in FREVO, which however adds 1e-6 times the cell's
    number to the fitness and thereby reorders close members. A torus less than three cells wide counts each
    neighbour once and no cell as its own neighbour. Failed members are not parents: their cell gets a mutated
    elite neighbour instead of a child, and a neighbourhood in which all failed is renewed. If the whole
    population is elite, where FREVO gets stuck, one cell is mutated. FREVO's three fixed obstacle patterns do
    not exist.
    """

    kind: ClassVar[str] = "cea2d"
    options_model = Cea2dOptions
    options: Cea2dOptions
    steady_state = True
    keeps_members = True
    start_as = "members"

    def __init__(self, options: Cea2dOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._genomes: Genomes = np.zeros((options.members, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.full(options.members, np.nan)
        self._cells = np.arange(options.members)  # generational: cells of the last genomes
        self._target_cells: dict[int, int] = {}  # steady state: cells of candidates in flight
        self._cursor = 0

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return the number of cells with members."""
        if isinstance(options, Cea2dOptions):
            return options.members
        return super().first_generation(options, representation)

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:  # noqa: ARG003 - any number
        """Accept any number, as recorded runs may have more than cells; new runs are refused them."""
        return None

    @property
    def budget(self) -> int:
        """Upper bound of evaluations, as survivors are not evaluated again."""
        return self.options.members * self.options.generations

    @property
    def generation_size(self) -> int:
        """Cells with members."""
        return self.options.members

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all members."""
        return self._fitness.copy()

    @cached_property
    def _torus(self) -> _engine.Torus:
        options = self.options
        return _engine.Torus(
            options.width,
            options.height,
            obstacles=options.obstacles,
            random=options.neighbourhood == "random",
            elite=options.elite,
            seed=self.seed,
        )

    @property
    def neighbours(self) -> list[list[int]]:
        """The neighbours of each member, by number; members are numbered column by column."""
        return [self._torus.neighbours(member) for member in range(self.options.members)]

    def _ask(self) -> Genomes:
        if self.generation == 0:
            return self.initials(range(self.options.members))
        cells = self._torus.changing(self._fitness)
        # If the whole population is elite, replace the worst member.
        self._cells = cells if len(cells) else np.array([np.argmin(self._fitness)])
        return self._children(self._cells, self.streams)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        self._genomes[self._cells], self._fitness[self._cells] = genomes, fitness

    def survivors(self) -> Genomes:
        """Return the members that survive in their cells, after `ask`."""
        return self._genomes[self._staying()]

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness[self._staying()] = fitness

    def _staying(self) -> NDArray[np.int64]:
        return np.delete(np.arange(self.options.members), self._cells)

    def _ask_next(self, index: int) -> Genome:
        members = self.options.members
        if index < members:
            self._target_cells[index] = index
            return self.initial_of(index)
        next_cell = self._torus.next(self._fitness, self._cursor)
        cell = self._cursor if next_cell is None else next_cell
        self._cursor = (cell + 1) % members
        self._target_cells[index] = cell
        children = self._children(np.array([cell]), lambda purpose, _: self.streams_of(purpose, index))
        return np.asarray(children[0])

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:
        cell = self._target_cells.pop(index)
        if self._torus.stays(self._fitness, cell) and not fitness > self._fitness[cell]:
            return  # an earlier candidate for this cell has become elite
        self._genomes[cell], self._fitness[cell] = genome, fitness

    def _children(
        self, cells: NDArray[np.int64], streams: Callable[[str, NDArray[np.int64]], Streams]
    ) -> Genomes:
        """Create new members for cells. streams: random streams by purpose and cells."""
        options, genomes = self.options, self._genomes
        drawn = streams("cea2d.choose", cells).units(2)
        parents, *rows = self._torus.choose(
            self._fitness, cells, drawn, mutate=options.mutate, crossover=options.crossover
        )
        mutated, crossed, renewed = rows
        children = np.empty((len(cells), self.representation.genome_size), dtype=np.float32)
        if len(renewed):
            children[renewed] = self.representation.initials(streams("initial", cells[renewed]))
        if len(crossed):
            children[crossed] = self.representation.crossovers(
                genomes[cells[crossed]],
                genomes[parents[crossed]],
                streams("cea2d.crossover", cells[crossed]),
            )
        if len(mutated):
            children[mutated] = self.representation.mutations(
                genomes[parents[mutated]],
                streams("cea2d.mutate", cells[mutated]),
                severity=options.severity,
                probability=options.probability,
            )
        return children
