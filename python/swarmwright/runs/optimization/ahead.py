"""The strategy in which the engine evolves by itself, some generations ahead of the store and the reports.

The record equals that of the strategy `Generational` byte for byte. Generations beyond the end of a run are
discarded.
"""

from collections.abc import Callable
from functools import partial
from typing import Self

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import engine_errors
from swarmwright.common.statistics import Figures
from swarmwright.controllers import Representation
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.methods.search import SearchMethod
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Results
from swarmwright.servers.rows import GenerationResult


class Ahead(Strategy):
    """Takes generations in order from a thread of the engine.

    Args:
        loop: the loop that uses the strategy.
        producer: the thread.
        backend: evaluates for the thread.
    """

    def __init__(self, loop: Loop, producer: _engine.Producer, backend: Backend) -> None:
        super().__init__(loop)
        self._producer = producer
        self._backend = backend
        self._next: Callable[[], None] | None = None  # completes the next generation
        self._is_over = False  # whether the engine has no more generations
        self._is_closed = False
        self._expected = 0
        self._expect()

    @classmethod
    def of(cls, loop: Loop, backend: Backend) -> Self | None:
        """Start the engine at the method's generation; return None if a generation needs Python."""
        method, ranking, representation = loop.method, loop.ranking, loop.representation
        if not (can_run_ahead(loop) and _genes_are_weights(representation)):
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
        """Whether the next generation is available without waiting."""
        return self._next is not None or self._producer.is_ready()

    def fits(self, most: int) -> bool:
        """Wait for the next generation; see `Strategy.fits`. The engine makes only generations that fit."""
        if self._is_closed:
            return not self._is_over and self.loop.account.evaluations < most
        return self._wait()

    def advance(self, backend: Backend) -> None:  # noqa: ARG002 - the thread has it already
        """Take the next generation, or raise the error that stopped the engine."""
        fits = self._wait()
        assert fits, "the method is done when no generation is left"
        assert self._next is not None
        complete, self._next = self._next, None
        complete()

    def replay_generation(self, stored: GenerationResult) -> bool:
        """Let the engine's search compare the genomes; see `Strategy.replay_generation`."""
        return replay_search(self.loop, stored)

    def close(self) -> None:
        """End the thread."""
        self._is_closed = True
        self._producer.close()

    def _wait(self) -> bool:
        """Wait for the next generation; return whether the budget of evaluations allows another."""
        if self._next is not None:
            return True
        if not self.is_ready:
            self.loop.recorder.use_idle_time()
        with engine_errors():
            produced = self._producer.next(self._progress)
        self._backend.check()
        self._is_over = produced is None
        if produced is None:
            return False
        genomes, episodes, metrics, fitness, _, figures, outcome, digests, attempts, warnings = produced
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
        """Pass a generation to the loop; arguments as for `Loop.record_generation`."""
        loop, method, number = self.loop, self.loop.method, self.loop.method.generation
        loop.check_size(len(genomes))
        episodes = results.fitness.size
        loop.recorder.progress(episodes, episodes, "")
        seeds = loop.ranking.seeds(loop.first_seed, number)
        _, failed = outcome
        if failed:
            self._backend.count_failed(results)
            results = loop.failures.add_warnings(results, seeds, number)

        def tell() -> GenerationResult:
            if failed:
                loop.check(fitness, results)
            method.count_generation(fitness)
            return loop.record_generation(
                genomes, seeds, results, fitness, outcome=outcome, figures=figures, digests=digests
            )

        if loop.complete(results, tell):
            self._expect()

    def _expect(self) -> None:
        """Publish the expected number of generations for watchers."""
        generations = self.loop.account.estimate_generations()
        if generations != self._expected:
            self._expected = generations
            self._producer.expect(generations)

    def _progress(self, done: int, total: int, waiting_for: str) -> None:
        self._backend.check()
        self.loop.recorder.progress(done, total, waiting_for)


def can_run_ahead(loop: Loop) -> bool:
    """Return whether the engine alone can do everything between ask and tell, except for the evaluation."""
    method, ranking = loop.method, loop.ranking
    if loop.constraints:
        return False
    if not isinstance(method, SearchMethod) or not method.ahead or type(ranking) is not Absolute:
        return False
    return not ranking.options.reevaluate and ranking.options.failure_fitness is None


def replay_search(loop: Loop, stored: GenerationResult) -> bool:
    """Pass a stored generation to a search, see `Strategy.replay_generation`.

    The engine compares the genomes, which avoids copies that take long in long runs. The strategy
    `Generational` does the same where `can_run_ahead`.
    """
    method = loop.method
    assert isinstance(method, SearchMethod)
    fitness = loop.ranking.score(stored.episodes)
    same = fitness.tobytes() == stored.fitness.tobytes()
    same = same and loop.ranking.seeds(loop.first_seed, method.generation) == stored.seeds
    if not same or not method.search.retell(stored.genomes, fitness):
        return False
    method.count_generation(fitness)
    loop.account.add(fitness, *_engine.outcome(fitness))
    return True


def _genes_are_weights(representation: Representation) -> bool:
    return type(representation).weights is Representation.weights
