"""Generations that the engine evolves by itself, some ahead of what is stored and reported.

The record is that of the ordinary loop to the byte. What was computed beyond the end of a run is thrown away.
"""

from typing import NamedTuple, Self

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import engine_errors
from swarmwright.common.statistics import Figures
from swarmwright.controllers import Representation
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.methods.search import SearchMethod
from swarmwright.servers.evaluation.base import Backend, Progress, Results


class Produced(NamedTuple):
    """What came out of a generation that was asked for, evaluated, ranked and told."""

    genomes: Genomes | _engine.Sample
    """Or what they are made from, where the store keeps that."""
    results: Results
    fitness: Fitness
    population: Fitness
    """Fitness of the method's population."""
    leader: int
    """Its best candidate."""
    failed: int
    """Candidates of which an episode failed, or whose fitness is not finite."""
    figures: Figures | None = None
    """Of the population, where they are known."""
    digests: _engine.Digests | None = None
    """Of its columns in the store, where another process has begun to compute them."""

    @classmethod
    def of(
        cls,
        genomes: Genomes | _engine.Sample,
        results: Results,
        fitness: Fitness,
        population: Fitness,
        failed: int | None = None,
    ) -> Self:
        """Return what has come out.

        Args:
            genomes: of the candidates, or what they are made from.
            results: of their episodes.
            fitness: of the candidates.
            population: fitness of the method's population.
            failed: candidates that failed; None: those without a fitness.
        """
        leader, without = _engine.outcome(fitness)
        return cls(genomes, results, fitness, population, leader, without if failed is None else failed)

    def digested(self) -> Self:
        """Begin to compute the digests, in another thread."""
        digests = _engine.Digests(self.fitness, self.results.fitness, self.results.metrics, self.genomes)
        return self._replace(digests=digests)


class Ahead:
    """Takes generations from a thread of the engine's, in their order.

    Args:
        producer: the thread.
        backend: what it evaluates with.
        on_progress: called while a generation is waited for.
    """

    def __init__(self, producer: _engine.Producer, backend: Backend, on_progress: Progress) -> None:
        self._producer = producer
        self._backend = backend
        self._on_progress = on_progress
        self._next: Produced | None = None
        self._expected = 0

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
        run: str,
    ) -> Self | None:
        """Begin where the method is; None where Python has a part in a generation."""
        if not (can_be_ahead(method, ranking) and _genes_are_weights(representation)):
            return None
        assert isinstance(method, SearchMethod)
        assert isinstance(ranking, Absolute)
        architecture = dict(representation.architecture())
        evaluator = backend.ahead(architecture)
        if evaluator is None:
            return None
        options, seeds = ranking.options, ranking.seeds(first_seed, method.generation)
        most = method.evaluation_limit
        with engine_errors():
            producer = _engine.Producer(
                method.search,
                evaluator,
                architecture,
                seed=seeds[0],
                growth=len(seeds) if options.seeds == "new" else 0,
                episodes=len(seeds),
                aggregate=options.aggregate,
                level=options.level,
                generations=method.options.generations - method.generation,
                evaluations=None if most is None else (most, method.evaluations),
                target=method.options.target,
                run=run,
                generation=method.generation,
            )
        return cls(producer, backend, on_progress)

    @property
    def is_ready(self) -> bool:
        """Whether the next generation is there, so that it need not be waited for."""
        return self._next is not None or self._producer.is_ready()

    def fits(self) -> bool:
        """Wait for the next generation; return whether there is one within the budget of evaluations."""
        if self._next is None:
            with engine_errors():
                found = self._producer.next(self._progress)
            self._backend.check()
            if found is None:
                return False
            genomes, episodes, metrics, fitness, population, figures, outcome, digests, attempts, warnings = (
                found
            )
            results = Results(episodes, metrics, self._backend.journal(attempts, warnings))
            self._next = Produced(genomes, results, fitness, population, *outcome, figures, digests)
        return True

    def take(self) -> Produced:
        """Return the next generation and go on to the one behind it; raise what has kept it from coming."""
        fits = self.fits()
        assert fits, "the method is done when no generation is left"
        assert self._next is not None
        found, self._next = self._next, None
        return found

    def expect(self, generations: int) -> None:
        """Tell those who watch servers how many generations the run is expected to have."""
        if generations != self._expected:
            self._expected = generations
            self._producer.expect(generations)

    def close(self) -> None:
        """End the thread."""
        self._producer.close()

    def _progress(self, done: int, total: int, waiting_for: str) -> None:
        self._backend.check()
        self._on_progress(done, total, waiting_for)


def can_be_ahead(method: Method, ranking: Ranking) -> bool:
    """Return whether the engine knows all that happens between asking and telling, but for the evaluation."""
    known = isinstance(method, SearchMethod) and method.ahead
    options = ranking.options
    return known and type(ranking) is Absolute and not options.reevaluate and options.failure_fitness is None


def _genes_are_weights(representation: Representation) -> bool:
    return type(representation).weights is Representation.weights
