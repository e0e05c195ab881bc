"""Generations that the engine evolves by itself, some ahead of what is stored and reported.

The record is that of the ordinary loop to the byte. What was computed beyond the end of a run is thrown away.
"""

from typing import NamedTuple, Self

from swarmwright import _engine
from swarmwright.core.errors import engine_errors
from swarmwright.core.statistics import Figures
from swarmwright.evaluation.base import Backend, Progress, Results
from swarmwright.methods import Method
from swarmwright.methods._search import SearchMethod
from swarmwright.rankings._base import Ranking
from swarmwright.rankings.absolute import Absolute
from swarmwright.representations import Representation
from swarmwright.store import Journal
from swarmwright.typing import Fitness, Genomes


class Produced(NamedTuple):
    """What came out of a generation that was asked for, evaluated, ranked and told."""

    genomes: Genomes
    results: Results
    fitness: Fitness
    population: Fitness
    """Fitness of the method's population."""
    leader: int
    """Its best candidate."""
    failed: int
    """Candidates whose evaluation failed."""
    figures: Figures | None = None
    """Of the population, where they are known."""
    digests: _engine.Digests | None = None
    """Of its columns in the store, where somebody has begun to compute them."""

    @classmethod
    def of(cls, genomes: Genomes, results: Results, fitness: Fitness, population: Fitness) -> Self:
        """Return what has come out; population: fitness of the method's population."""
        return cls(genomes, results, fitness, population, *_engine.outcome(fitness))

    def digested(self) -> Self:
        """Begin to compute the digests, in another thread."""
        digests = _engine.Digests(self.fitness, self.results.fitness, self.results.metrics, self.genomes)
        return self._replace(digests=digests)


class Ahead:
    """Takes generations from a thread of the engine's, in their order.

    Args:
        producer: the thread.
        on_progress: called while a generation is waited for.
    """

    def __init__(self, producer: _engine.Producer, on_progress: Progress) -> None:
        self._producer = producer
        self._on_progress = on_progress
        self._next: Produced | None = None

    @classmethod
    def of(
        cls,
        method: Method,
        ranking: Ranking,
        representation: Representation,
        backend: Backend,
        on_progress: Progress,
        *,
        first_seed: int,
    ) -> Self | None:
        """Begin where the method is; None where Python, or a server, has a part in a generation."""
        known = isinstance(method, SearchMethod) and method.ahead
        ranked = type(ranking) is Absolute and not ranking.options.reevaluate
        if not (known and ranked and _genes_are_weights(representation)):
            return None
        assert isinstance(method, SearchMethod)
        assert isinstance(ranking, Absolute)
        evaluator = backend.evaluator(dict(representation.architecture()))
        if evaluator is None:
            return None
        options, seeds = ranking.options, ranking.seeds(first_seed, method.generation)
        with engine_errors():
            producer = _engine.Producer(
                method.search,
                evaluator,
                seed=seeds[0],
                growth=len(seeds) if options.seeds == "new" else 0,
                episodes=len(seeds),
                aggregate=options.aggregate,
                level=options.level,
                generations=method.options.generations - method.generation,
            )
        return cls(producer, on_progress)

    def peek(self) -> Produced:
        """Return the next generation, as soon as it is there; raise what has kept it from coming."""
        if self._next is None:
            with engine_errors():
                found = self._producer.next(self._on_progress)
            assert found is not None, "the method is done when no generation is left"
            genomes, episodes, metrics, fitness, population, figures, outcome, digests = found
            results = Results(episodes, metrics, Journal())
            self._next = Produced(genomes, results, fitness, population, *outcome, figures, digests)
        return self._next

    def take(self) -> Produced:
        """Return the next generation and go on to the one behind it."""
        found = self.peek()
        self._next = None
        return found

    def close(self) -> None:
        """End the thread."""
        self._producer.close()


def _genes_are_weights(representation: Representation) -> bool:
    return type(representation).weights is Representation.weights
