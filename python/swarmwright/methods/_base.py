"""What every method does."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from swarmwright._errors import InputError
from swarmwright._options import Options
from swarmwright._random import Stream, Streams
from swarmwright.rankings._base import Fitness
from swarmwright.representations._base import Genomes, Representation


class MethodOptions(Options):
    """Options of every method."""

    generations: int = Field(default=200, ge=1, le=1_000_000_000)
    """How often candidates are asked for and evaluated."""
    target: float | None = None
    """Stop as soon as a candidate's fitness is at least this; without it the whole budget is used."""


class Method(ABC):
    """Optimization is a conversation: `ask` for genomes, evaluate them in any way, `tell` their fitness.

    `ask` and `tell` are templates around `_ask` and `_tell`, which a method implements; they keep count,
    check shapes and see to it that a method meets each generation once. Fitness may have any sign; more is
    better; NaN means that the evaluation failed: such a candidate ranks below all others and its number is
    never computed with. A method draws its random numbers from `stream`, by generation and candidate, never
    from a shared source, so the same seed gives the same genomes whatever happens in between.

    Args:
        options: this method's section of the experiment.
        representation: gives genomes their operators.
        seed: of the experiment.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[MethodOptions]]
    """Typed options, with `kind` among them."""
    keeps_members: ClassVar[bool] = False
    """Whether members stay from one generation to the next with the fitness that they have: see `kept`."""

    def __init__(self, options: MethodOptions, representation: Representation, *, seed: int) -> None:
        self.options = options
        self.representation = representation
        self.seed = seed
        self.generation = 0
        """The generation that `ask` asks for, or has asked for last."""
        self.evaluations = 0
        """Candidates told so far."""
        self.done = False
        """Whether the budget is used up or the target is reached."""
        self._asked: Genomes | None = None

    def ask(self) -> Genomes:
        """Return the genomes of this generation that need evaluation: float32, (n, genome_size), n >= 1.

        Raises InputError when the fitness of the last ones has not been told, or when the method is done.
        """
        if self._asked is not None:
            raise InputError(
                "the fitness of the genomes asked for last is missing: tell it before asking again"
            )
        if self.done:
            raise InputError(f"the method is done after {self.generation + 1} generation(s); start a new one")
        self._asked = self._ask()
        return self._asked.copy()

    def kept(self) -> Genomes:
        """Return the members that stay, (k, genome_size), after `ask`; none with most methods.

        Where evaluations are noisy, a lucky one would stay for ever: these can be evaluated again along with
        those asked for, and `tell` takes what came out.
        """
        return np.empty((0, self.representation.genome_size), dtype=np.float32)

    def tell(self, fitness: Fitness, kept: Fitness | None = None) -> None:
        """Take the fitness of the genomes asked for last: float64, (n,), in their order; NaN = failed.

        kept: new fitness of the members that `kept` returned, (k,), if they were evaluated again. Raises
        InputError when nothing was asked for or the number of values is another.
        """
        if self._asked is None:
            raise InputError("there is nothing to tell: ask for genomes first")
        values = _checked(fitness, len(self._asked), "asked were")
        if kept is not None:
            self._rescore(_checked(kept, len(self.kept()), "kept are"))
        self._tell(self._asked, values)
        self._asked = None
        self.evaluations += len(values)
        target = self.options.target
        reached = target is not None and bool((values >= target).any())
        self.done = reached or self.generation + 1 >= self.options.generations
        if not self.done:
            self.generation += 1

    def _rescore(self, fitness: Fitness) -> None:
        """Take new fitness of the members that stay; finite or NaN. Methods that keep members have it."""
        raise NotImplementedError(f"{self.kind} keeps no members")

    def stream(self, purpose: str, candidate: int = 0) -> Stream:
        """Return the random numbers for a purpose and candidate of this generation."""
        return Stream(self.seed, purpose, self.generation, candidate)

    def streams(self, purpose: str, candidates: Sequence[int]) -> Streams:
        """Return the random numbers for a purpose and several candidates of this generation."""
        return Streams(self.seed, purpose, self.generation, candidates)

    def initials(self, candidates: Sequence[int]) -> Genomes:
        """Return random genomes to start from; the same for every method, by generation and candidate."""
        return self.representation.initials(self.streams("initial", candidates))

    @property
    @abstractmethod
    def budget(self) -> int:
        """Number of evaluations of the whole run, when nothing fails and no target stops it."""

    @property
    @abstractmethod
    def population_fitness(self) -> Fitness:
        """Fitness of the population after the last `tell`: what the figures of a generation describe."""

    @abstractmethod
    def _ask(self) -> Genomes:
        """Return the genomes of generation `self.generation`."""

    @abstractmethod
    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        """Take their fitness; finite or NaN."""


def _checked(fitness: Fitness, count: int, which: str) -> Fitness:
    values = np.asarray(fitness, dtype=np.float64)
    if values.shape != (count,):
        raise InputError(f"fitness has the shape {values.shape}; {which} {count} genomes")
    return np.where(np.isfinite(values), values, np.nan)
