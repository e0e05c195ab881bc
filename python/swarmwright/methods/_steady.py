"""Steady state: candidate by candidate, without idle servers and independent of the servers' timing."""

from abc import ABC
from collections import deque
from functools import cached_property
from math import isfinite, nan
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.random_numbers import Streams
from swarmwright.common.typing import Genome, Genomes
from swarmwright.controllers import Representation

if TYPE_CHECKING:
    from swarmwright.methods._base import MethodOptions


class SteadyState(ABC):
    """The half of a method that works in steady state: `ask_next` and `tell_next`.

    Candidate n is made when the results of candidates 0 to n - in_flight have been told, in order of their
    index, and of no later one. So it depends on `in_flight`, and not on how many servers there are, how fast
    they answer or when candidates are asked for. The caller keeps results that arrive earlier.
    """

    options: "MethodOptions"
    representation: Representation
    seed: int
    generation: int
    evaluations: int
    done: bool
    start: Genomes

    steady_state: ClassVar[bool] = False
    """Whether the method can work candidate by candidate."""

    def _begin_steady_state(self) -> None:
        self._made = 0
        """Candidates made so far, of which `_handed_out` have been asked for."""
        self._handed_out = 0
        self._untold: deque[Genome] = deque()

    @property
    def generation_size(self) -> int:
        """So many evaluations in a row make a generation of the record."""
        raise NotImplementedError

    @property
    def can_ask(self) -> bool:
        """Whether `ask_next` has a candidate now; if not, `tell_next` or `done` comes first."""
        last = min(self.evaluations + self.options.in_flight, self._last)
        return not self.done and self._handed_out < last

    def ask_next(self) -> tuple[int, Genome]:
        """Return the next candidate that needs evaluation: its index, from 0, and its genome (genome_size,).

        Raises InputError when as many as `in_flight` are without fitness, when there are no more candidates,
        or when the method works in generations.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self._handed_out == self._last:
            raise InputError("all candidates have been asked for: tell the fitness of the last ones")
        if not self.can_ask:
            raise InputError(
                f"{self.options.in_flight} candidate(s) are in flight: "
                f"tell the fitness of candidate {self.evaluations} before asking again"
            )
        self._make(self._handed_out + 1)
        self._handed_out += 1
        return self._handed_out - 1, self._untold[self._handed_out - 1 - self.evaluations].copy()

    def tell_next(self, fitness: float) -> None:
        """Take the fitness of candidate `evaluations`, the lowest one not told yet; NaN = failed.

        Raises InputError when that candidate has not been asked for.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self.evaluations == self._handed_out:
            raise InputError("there is nothing to tell: ask for a candidate first")
        # Make all candidates that must not depend on this result before it is told.
        self._make(min(self.evaluations + self.options.in_flight, self._last))
        value = float(fitness) if isfinite(fitness) else nan
        self._told(self.evaluations, self._untold.popleft(), value)
        self.evaluations += 1
        target = self.options.target
        reached = target is not None and value >= target
        self.done = reached or self.evaluations >= self._last
        if not self.done:
            self.generation = self.evaluations // self.generation_size

    def streams_of(self, purpose: str, index: int) -> Streams:
        """Return the random numbers for a purpose and one candidate.

        They are those of candidate index % generation_size of generation index // generation_size.
        """
        generation, candidate = divmod(index, self.generation_size)
        return Streams(self.seed, purpose, generation, [candidate])

    def initial_of(self, index: int) -> Genome:
        """Return a random genome for a candidate; see `streams_of`. The first are those to start from."""
        if index < len(self.start):
            return np.array(self.start[index])
        genomes = self.representation.initials(self.streams_of("initial", index))
        return np.asarray(genomes[0])

    def _next(self, index: int) -> Genome:
        """Return the genome of candidate `index`."""
        raise NotImplementedError

    def _told(self, index: int, genome: Genome, fitness: float) -> None:
        """Take the fitness of candidate `index`; finite or NaN. Called in order of index."""
        raise NotImplementedError

    def _check_operation(self, needed: str, instead: str) -> None:
        if self.options.operation != needed:
            raise InputError(f"the method's operation is {self.options.operation}: use {instead}")

    def _check_not_done(self) -> None:
        if self.done:
            raise InputError(f"the method is done after {self.generation + 1} generation(s); start a new one")

    @cached_property
    def _last(self) -> int:
        """How many candidates there are in all: whole generations, at least one."""
        size, most = self.generation_size, self.options.evaluations
        last = self.options.generations * size
        return last if most is None else min(last, max(most // size, 1) * size)

    def _make(self, count: int) -> None:
        """Make candidates until there are `count`."""
        while self._made < count:
            genome = self._next(self._made)
            if is_plug_in(type(self)):
                size = (self.representation.genome_size,)
                genome = numbers(self, "_next", genome, size, "a genome, (genome_size,)")
            self._untold.append(genome)
            self._made += 1
