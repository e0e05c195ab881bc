"""Methods that the engine knows wholly: here are their options, and what they need to begin."""

from abc import abstractmethod
from typing import cast

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.methods._base import Method


class SearchMethod(Method):
    """A conversation with the engine's search.

    Every number is made by the engine, by single IEEE 754 operations in a fixed order, so it has the same
    bits on every machine. Where nothing else is needed, the engine evolves by itself, see `ahead`.
    """

    _begun: _engine.Search | None = None
    _fitness: Fitness | None = None

    @abstractmethod
    def _begin(self) -> _engine.Search:
        """Return the search as it begins; called once, when the start is known."""

    @property
    def search(self) -> _engine.Search:
        """The engine's search, in the state in which it is."""
        if self._begun is None:
            use_threads()
            self._begun = self._begin()
        return self._begun

    def _state(self, name: str) -> NDArray[np.float64]:
        """Return a part of the search's state."""
        return self.search.state(name)

    @property
    def ahead(self) -> bool:
        """Whether the engine may ask and tell the search by itself: no subclass does it in another way."""
        kind, names = type(self), ("ask", "tell", "_ask", "_tell")
        own = next(base for base in kind.__mro__ if base.__module__.startswith("swarmwright.methods."))
        return all(getattr(kind, name) is getattr(own, name) for name in names)

    @property
    def _forgets_asked(self) -> bool:
        """The search has them; a subclass may use them."""
        return self.ahead

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample."""
        return np.empty(0) if self._fitness is None else self._fitness

    @property
    def sample(self) -> _engine.Sample | None:
        """What the search made the genomes from that were asked for last; None if a subclass makes them."""
        return self.search.sample if self.ahead else None

    def _ask(self) -> Genomes:
        with engine_errors():
            return self.search.ask()

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the search knows them
        self._fitness = fitness
        self.search.tell(fitness)


class KeepsMembers(SearchMethod):
    """A search with members that stay until something better replaces them."""

    keeps_members = True
    start_as = "members"

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members."""
        return cast("Fitness", self.search.fitness)

    def kept(self) -> Genomes:
        """Return the members that stay beside those asked for, from the second generation on."""
        return cast("Genomes", self.search.members)

    def _rescore(self, fitness: Fitness) -> None:
        self.search.rescore(fitness)
