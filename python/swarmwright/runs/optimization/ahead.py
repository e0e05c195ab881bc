"""The strategy of the engine, which evolves by itself, some generations ahead of what is stored and reported.

The record is that of the strategy `Generational` to the byte. What was computed beyond the end of a run is
thrown away.
"""

from collections.abc import Callable
from functools import partial
from typing import Self

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import engine_errors
from swarmwright.common.statistics import Figures
from swarmwright.controllers import Representation
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.methods.search import SearchMethod
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Results
from swarmwright.servers.rows import GenerationResult


class Ahead(Strategy):
    """Takes generations from a thread of the engine's, in their order.

    Args:
        loop: whose strategy it is.
        producer: the thread.
        backend: what it evaluates with.
    """

    def __init__(self, loop: Loop, producer: _engine.Producer, backend: Backend) -> None:
        super().__init__(loop)
        self._producer = producer
        self._backend = backend
        self._next: Callable[[], None] | None = None  # completes the next generation
        self._is_over = False  # no generation is left
        self._is_closed = False
        self._expected = 0
        self._expect()

    @classmethod
    def of(cls, loop: Loop, backend: Backend) -> Self | None:
        """Begin where the method is; None where Python has a part in a generation."""
        method, ranking, representation = loop.method, loop.ranking, loop.representation
        if not (can_be_ahead(method, ranking) and _genes_are_weights(representation)):
            return None
        assert isinstance(method, SearchMethod)
        assert isinstance(ranking, Absolute)
        architecture = dict(representation.architecture())
        evaluator = backend.background_evaluator(architecture)
        if evaluator is None:
            return None
        options, seeds = ranking.options, ranking.seeds(loop.first_seed, method.generation)
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
                run=loop.name,
                generation=method.generation,
            )
        return cls(loop, producer, backend)

    @property
    def is_ready(self) -> bool:
        """Whether the next generation is there, so that it need not be waited for."""
        return self._next is not None or self._producer.is_ready()

    def fits(self, most: int) -> bool:
        """Wait for the next generation; see `Strategy.fits`. The engine makes none that does not fit."""
        if self._is_closed:
            return not self._is_over and self.loop.account.evaluations < most
        return self._wait()

    def advance(self, backend: Backend) -> None:  # noqa: ARG002 - the one that was lent to the thread
        """Take the next generation; raise what has kept it from coming."""
        fits = self._wait()
        assert fits, "the method is done when no generation is left"
        assert self._next is not None
        complete, self._next = self._next, None
        complete()

    def retell(self, stored: GenerationResult) -> bool:
        """Have the engine's search compare the genomes; see `Strategy.retell`."""
        return retold(self.loop, stored)

    def close(self) -> None:
        """End the thread."""
        self._is_closed = True
        self._producer.close()

    def _wait(self) -> bool:
        """Wait for the next generation; return whether there is one within the budget of evaluations."""
        if self._next is not None:
            return True
        if not self.is_ready:
            self.loop.recorder.has_time()
        with engine_errors():
            found = self._producer.next(self._progress)
        self._backend.check()
        self._is_over = found is None
        if found is None:
            return False
        genomes, episodes, metrics, fitness, _, figures, outcome, digests, attempts, warnings = found
        results = Results(episodes, metrics, self._backend.build_journal(attempts, warnings))
        self._next = partial(self._complete, genomes, results, fitness, outcome, figures, digests)
        return True

    def _complete(
        self,
        genomes: Genomes | _engine.Sample,
        results: Results,
        fitness: Fitness,
        outcome: tuple[int, int],
        figures: Figures,
        digests: _engine.Digests,
    ) -> None:
        """Hand a generation to the loop; arguments as those of `Loop.told`."""
        loop, method, number = self.loop, self.loop.method, self.loop.method.generation
        loop.check_size(len(genomes))
        episodes = results.fitness.size
        loop.recorder.progress(episodes, episodes, "")
        seeds = loop.ranking.seeds(loop.first_seed, number)
        _, failed = outcome
        if failed:
            self._backend.count_failed(results)
            results = loop.failures.named(results, seeds, number)

        def tell() -> GenerationResult:
            if failed:
                loop.check(fitness, results)
            method.passed(fitness)
            return loop.told(
                genomes, seeds, results, fitness, outcome=outcome, figures=figures, digests=digests
            )

        if loop.complete(results, tell):
            self._expect()

    def _expect(self) -> None:
        """Tell those who watch servers how many generations the run is expected to have."""
        generations = self.loop.account.expected_generations()
        if generations != self._expected:
            self._expected = generations
            self._producer.expect(generations)

    def _progress(self, done: int, total: int, waiting_for: str) -> None:
        self._backend.check()
        self.loop.recorder.progress(done, total, waiting_for)


def can_be_ahead(method: Method, ranking: Ranking) -> bool:
    """Return whether the engine knows all that happens between asking and telling, but for the evaluation."""
    known = isinstance(method, SearchMethod) and method.ahead
    options = ranking.options
    return known and type(ranking) is Absolute and not options.reevaluate and options.failure_fitness is None


def retold(loop: Loop, stored: GenerationResult) -> bool:
    """Tell a search a generation, see `Strategy.retell`; the engine compares the genomes.

    In long runs, each copy of them counts. The strategy `Generational` does the same where `can_be_ahead`.
    """
    method = loop.method
    assert isinstance(method, SearchMethod)
    fitness = loop.ranking.score(stored.episodes)
    same = fitness.tobytes() == stored.fitness.tobytes()
    same = same and loop.ranking.seeds(loop.first_seed, method.generation) == stored.seeds
    if not same or not method.search.retell(stored.genomes, fitness):
        return False
    method.passed(fitness)
    loop.account.add(fitness, *_engine.outcome(fitness))
    return True


def _genes_are_weights(representation: Representation) -> bool:
    return type(representation).weights is Representation.weights
