"""Methods whose search is implemented in the engine."""

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
    """A method that delegates to a search of the engine.

    The engine computes by single IEEE 754 operations in a fixed order, so that all machines give the same
    bits. If nothing else is involved, the engine evolves by itself, see `ahead`.
    """

    _search: _engine.Search | None = None
    _fitness: Fitness | None = None

    @abstractmethod
    def _begin(self) -> _engine.Search:
        """Create the search; called once, when `start` is known."""

    @property
    def search(self) -> _engine.Search:
        """The engine's search in its current state."""
        if self._search is None:
            use_threads()
            self._search = self._begin()
        return self._search

    def _state(self, name: str) -> NDArray[np.float64]:
        """Return a part of the search's state."""
        return self.search.state(name)

    @property
    def ahead(self) -> bool:
        """Whether the engine may run the search by itself, as no subclass overrides ask or tell."""
        kind, names = type(self), ("ask", "tell", "_ask", "_tell")
        base_class = next(base for base in kind.__mro__ if base.__module__.startswith("swarmwright.methods."))
        return all(getattr(kind, name) is getattr(base_class, name) for name in names)

    @property
    def _ignores_genomes(self) -> bool:
        """Whether only the search uses the genomes."""
        return self.ahead

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample."""
        return np.empty(0) if self._fitness is None else self._fitness

    @property
    def sample(self) -> _engine.Sample | None:
        """Source of the last genomes; None if a subclass makes them."""
        return self.search.sample if self.ahead else None

    def _ask(self) -> Genomes:
        with engine_errors():
            return self.search.ask()

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the search knows them
        self._fitness = fitness
        self.search.tell(fitness)


class KeepsMembers(SearchMethod):
    """A search with members that survive until a better candidate replaces them."""

    keeps_members = True
    start_as = "members"

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members."""
        return cast("Fitness", self.search.fitness)

    def survivors(self) -> Genomes:
        """Return the surviving members, from the second generation on."""
        return cast("Genomes", self.search.members)

    def _rescore(self, fitness: Fitness) -> None:
        self.search.rescore(fitness)
