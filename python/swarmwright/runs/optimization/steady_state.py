"""The steady-state strategy: evaluate candidate by candidate, so that no server waits for the slowest.

Runs are reproducible because candidate n depends only on the results of candidates 0 to n - in_flight, told
in this order. Results that arrive early wait for their turn. So the run depends neither on the number of
servers nor on their speed. A generation in the record consists of as many consecutive candidates as the
population has members.
"""

import sys
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome, Genomes
from swarmwright.common.statistics import means
from swarmwright.experiment.budget import EndReason
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Controllers, Results, weights_of
from swarmwright.servers.rows import GenerationResult, Journal


class _Evaluation(NamedTuple):
    """A candidate whose result the method has been told."""

    genome: Genome
    episodes: NDArray[np.float64]
    metrics: NDArray[np.float64]
    fitness: float
    violation: float


class SteadyState(Strategy):
    """Asks the method for candidates whenever it has any, so that every server has work."""

    def __init__(self, loop: Loop) -> None:
        super().__init__(loop)
        self._seeds = loop.ranking.seeds(loop.first_seed)
        self._flying: deque[Genome] = deque()  # in flight: asked, and not told yet
        self._early: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        self._part: list[_Evaluation] = []  # since the last complete generation
        self._journal = Journal()  # since the last complete generation

    def fits(self, most: int) -> bool:
        """Return whether the budget holds; the method itself plans complete generations."""
        return self.loop.account.evaluations <= most

    def find_exhausted_budget(self) -> EndReason:
        """Return which budget a finished method has used up."""
        method, last = self.loop.method, self.loop.budget.generations
        whole = last is not None and method.evaluations >= last * method.generation_size
        return "generations" if whole else "evaluations"

    def advance(self, backend: Backend) -> None:
        """Evaluate all remaining candidates; several generations may be in progress at a time."""
        loop, method = self.loop, self.loop.method
        first = method.evaluations  # the backend counts from 0
        numbers = range(first, sys.maxsize)
        loop.check_size(method.generation_size)
        self._ask()
        done, whole = (count * len(self._seeds) for count in (first, loop.account.max_evaluations))
        loop.announce(backend, None, (done, whole))
        controllers = Controllers.from_genomes(loop.representation, np.array(self._flying, dtype=np.float32))
        with loop.first_evaluations(0) as on_results:

            def feed(candidates: Sequence[int], results: Results) -> NDArray[np.float32] | None:
                rows = {candidate: row for row, candidate in enumerate(candidates)}
                results = loop.failures.add_warnings(results, self._seeds, rows=rows, first=first)
                self._journal.extend(results.journal.renumber(numbers))
                if on_results is not None:
                    on_results(candidates, results)
                for row, candidate in enumerate(candidates):
                    self._early[numbers[candidate]] = results.fitness[row], results.metrics[row]
                while not method.done and method.evaluations in self._early:
                    self._tell(*self._early.pop(method.evaluations))
                    whole = len(self._part) == method.generation_size
                    if (whole or method.done) and not self._complete():
                        return None
                return None if method.done else self._weights(self._ask())

            backend.stream(controllers, self._seeds, feed, loop.recorder.progress)

    def replay_generation(self, stored: GenerationResult) -> bool:
        """Ask for each candidate and tell the stored results; see `Strategy.replay_generation`."""
        for genome, episodes, metrics in zip(
            stored.expand_genomes(), stored.episodes, stored.metrics, strict=True
        ):
            self._ask()
            if not self._flying or self._flying[0].tobytes() != genome.tobytes():
                return False
            self._tell(episodes, metrics)
        return self._record(self._results()).fitness.tobytes() == stored.fitness.tobytes()

    def _ask(self) -> list[Genome]:
        """Ask for all candidates available now; return the new ones."""
        new = []
        while self.loop.method.can_ask:
            _, genome = self.loop.method.ask_next()
            new.append(genome)
        self._flying.extend(new)
        return new

    def _tell(self, episodes: NDArray[np.float64], metrics: NDArray[np.float64]) -> None:
        """Tell the method the fitness of the first candidate in flight."""
        fitness = float(self.loop.ranking.score(episodes[np.newaxis])[0])
        violations = self.loop.constraints.measure(metrics[np.newaxis])
        violation = None if violations is None else float(violations[0])
        self._part.append(_Evaluation(self._flying.popleft(), episodes, metrics, fitness, violation or 0.0))
        needed: dict[str, Any] = {}
        if self.loop.needed:
            needed["metrics"] = means(metrics[:, self.loop.needed][np.newaxis])[0]
        if violation is not None:
            needed["violation"] = violation
        self.loop.method.tell_next(fitness, **needed)

    def _complete(self) -> bool:
        """Pass a generation to the loop; return whether to continue."""
        results = self._results()
        self._journal = Journal()

        def tell() -> GenerationResult:
            self.loop.check(self._fitness(), results)
            return self._record(results)

        return self.loop.complete(results, tell) and not self.loop.account.time_is_over

    def _record(self, results: Results) -> GenerationResult:
        """Record the candidates told so far as a generation, and begin the next one."""
        genomes: Genomes = np.array([evaluation.genome for evaluation in self._part], dtype=np.float32)
        fitness = self._fitness()
        violations = None
        if self.loop.constraints:
            violations = np.array([evaluation.violation for evaluation in self._part])
        self._part = []
        failures = self.loop.find_failed_candidates(results)
        failed = None if failures is None else int(np.count_nonzero(failures | np.isnan(fitness)))
        return self.loop.record_generation(
            genomes,
            self._seeds,
            results,
            fitness,
            failed=failed,
            violations=violations,
        )

    def _results(self) -> Results:
        episodes, metrics = (
            [getattr(evaluation, name) for evaluation in self._part] for name in ("episodes", "metrics")
        )
        return Results(np.array(episodes), np.array(metrics), self._journal)

    def _fitness(self) -> NDArray[np.float64]:
        return np.array([evaluation.fitness for evaluation in self._part])

    def _weights(self, genomes: list[Genome]) -> NDArray[np.float32]:
        rows = np.array(genomes, dtype=np.float32).reshape(-1, self.loop.representation.genome_size)
        return np.ascontiguousarray(weights_of(self.loop.representation, rows), dtype=np.float32)
