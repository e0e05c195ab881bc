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
    """FREVO's CEA2D with its defaults: members on a torus meet only their neighbours.

    The four shares add up to 1.
    """

    kind: Literal["cea2d"] = "cea2d"
    width: int = Field(default=10, ge=2, le=3000)
    """Columns of the torus."""
    height: int = Field(default=10, ge=2, le=3000)
    """Rows of the torus; width x height is the population."""
    neighbourhood: Literal["grid", "random"] = "grid"
    """grid: the 8 cells around a cell. random: 8 cells drawn once from all."""
    obstacles: int = Field(default=0, ge=0)
    """Empty cells, drawn at random; they separate regions."""
    elite: float = Field(default=0.11, ge=0, le=1)
    """Share of a neighbourhood, the cell itself included, that stays: of 9 cells, with the default, the
    best."""
    mutate: float = Field(default=0.59, ge=0, le=1)
    """Share of mutated copies of an elite neighbour."""
    crossover: float = Field(default=0.30, ge=0, le=1)
    """Share of children of a cell's own member and an elite neighbour."""
    renew: float = Field(default=0.0, ge=0, le=1)
    """Share of new random members."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """Size of mutations, as a share of the initial range of weights and biases."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability of a gene to be changed by a mutation."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        total = math.fsum([self.elite, self.mutate, self.crossover, self.renew])
        if abs(total - 1) > 1e-6:
            raise ValueError(f"elite, mutate, crossover and renew must add up to 1, not {total:.6g}")
        if self.elite > 0.9:
            raise ValueError(f"no new candidate is made: elite must be at most 0.9, not {self.elite:.6g}")
        if self.members < 2:
            raise ValueError(f"obstacles must leave 2 of {self.width * self.height} cells at least")
        return self

    @property
    def members(self) -> int:
        """Cells that are not obstacles."""
        return self.width * self.height - self.obstacles


class Cea2d(Method):
    """Each member competes and mates with its neighbours only, so good genes spread slowly.

    A member that is among the best of its neighbourhood stays and keeps its fitness. Every other cell gets a
    mutated copy of an elite neighbour, or the child of its own member and an elite neighbour, or a random
    member. All cells change at once, and only new members are evaluated. In steady state cells change one
    after another, column by column, again and again; cells whose member stays are passed over.

    Source: CEA2D of FREVO (Dittrich, Zhevzhyk; Components/Methods/CEA2D). It differs in four points. Of equal
    members the one in the later cell is ahead, as in FREVO, but FREVO gets there by adding 1e-6 times the
    cell's number to the fitness, which reorders members that are closer than that. A torus less than three
    cells wide counts each neighbour once and no cell as its own neighbour. A member whose evaluation failed
    is not a parent: in its cell an elite neighbour is mutated where FREVO crosses, and a neighbourhood in
    which all failed is renewed. And where the whole population is elite, which FREVO then never leaves, one
    cell is mutated. FREVO's three fixed patterns of obstacles do not exist here.
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
        self._cells = np.arange(options.members)  # generational: where the genomes asked for last go
        self._places: dict[int, int] = {}  # steady state: where candidates in flight go
        self._cursor = 0

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return the number of cells with members."""
        if isinstance(options, Cea2dOptions):
            return options.members
        return super().first_generation(options, representation)

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:  # noqa: ARG003 - any number
        """Take any number: runs are recorded with more than there are cells. New ones are refused them."""
        return None

    @property
    def budget(self) -> int:
        """Evaluations of the whole run at most: members that stay are not evaluated again."""
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
        # Where the whole population is elite, the worst one goes.
        self._cells = cells if len(cells) else np.array([np.argmin(self._fitness)])
        return self._children(self._cells, self.streams)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        self._genomes[self._cells], self._fitness[self._cells] = genomes, fitness

    def kept(self) -> Genomes:
        """Return the members that stay in their cells; after `ask`."""
        return self._genomes[self._staying()]

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness[self._staying()] = fitness

    def _staying(self) -> NDArray[np.int64]:
        return np.delete(np.arange(self.options.members), self._cells)

    def _next(self, index: int) -> Genome:
        members = self.options.members
        if index < members:
            self._places[index] = index
            return self.initial_of(index)
        found = self._torus.next(self._fitness, self._cursor)
        cell = self._cursor if found is None else found
        self._cursor = (cell + 1) % members
        self._places[index] = cell
        children = self._children(np.array([cell]), lambda purpose, _: self.streams_of(purpose, index))
        return np.asarray(children[0])

    def _told(self, index: int, genome: Genome, fitness: float) -> None:
        cell = self._places.pop(index)
        if self._torus.stays(self._fitness, cell) and not fitness > self._fitness[cell]:
            return  # an earlier candidate for this cell is one of the best meanwhile
        self._genomes[cell], self._fitness[cell] = genome, fitness

    def _children(
        self, cells: NDArray[np.int64], streams: Callable[[str, NDArray[np.int64]], Streams]
    ) -> Genomes:
        """Return the members that come into cells; streams: random numbers by purpose and cells."""
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
