"""The optimization loop in steady state: candidate by candidate, so that no server waits for the slowest.

What makes it repeatable: candidate n is made of the results of candidates 0 to n - in_flight, told in this
order, and of no later one. Results that arrive earlier are kept until then. So the run depends neither on the
number of servers nor on their speed. A generation of the record is so many candidates in a row as a
population has members.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome, Genomes
from swarmwright.experiment.budget import Ended
from swarmwright.runs.optimization.ahead import Produced
from swarmwright.runs.optimization.generation import OnGeneration, Told
from swarmwright.runs.optimization.loop import Loop
from swarmwright.servers.evaluation.base import Backend, Controllers, Progress, Results, weights_of
from swarmwright.servers.rows import Evaluated, Journal


@dataclass
class _Part:
    """The candidates told since the last whole generation."""

    genomes: list[Genome] = field(default_factory=list)
    episodes: list[NDArray[np.float64]] = field(default_factory=list)
    metrics: list[NDArray[np.float64]] = field(default_factory=list)
    fitness: list[float] = field(default_factory=list)

    def results(self) -> Results:
        return Results(np.array(self.episodes), np.array(self.metrics), Journal())


class SteadyLoop(Loop):
    """See `Loop`; here every server has work as long as there is any."""

    def __init__(self, *arguments: Any) -> None:  # noqa: ANN401 - those of `Loop`
        super().__init__(*arguments)
        self._seeds = self._ranking.seeds(self._first_seed)
        self._flying: deque[Genome] = deque()  # asked for and not told
        self._early: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        self._part = _Part()
        self._journal = Journal()
        self._over = False  # the time is over

    def _again(self, evaluated: Evaluated) -> bool:
        """Tell the method a generation that is stored; see `Loop`."""
        rows = zip(evaluated.made(), evaluated.episodes, evaluated.metrics, strict=True)
        for genome, episodes, metrics in rows:
            self._ask_all()
            if not self._flying or self._flying[0].tobytes() != genome.tobytes():
                return False
            self._tell_first(episodes, metrics)
        return self._told_part().found.fitness.tobytes() == evaluated.fitness.tobytes()

    def _ask_all(self) -> list[Genome]:
        """Ask for all candidates available now; return the new ones."""
        new = []
        while self._method.can_ask:
            _, genome = self._method.ask_next()
            new.append(genome)
        self._flying.extend(new)
        return new

    def _tell_first(self, episodes: NDArray[np.float64], metrics: NDArray[np.float64]) -> None:
        """Tell the fitness of the first candidate in flight."""
        fitness = float(self._ranking.score(episodes[np.newaxis])[0])
        part = self._part
        part.genomes.append(self._flying.popleft())
        part.episodes.append(episodes)
        part.metrics.append(metrics)
        part.fitness.append(fitness)
        self._method.tell_next(fitness)

    def _told_part(self) -> Told:
        """Return the candidates told as a generation, and begin the next one."""
        part, self._part = self._part, _Part()
        number = self._account.evaluations // self._method.generation_size
        genomes: Genomes = np.array(part.genomes, dtype=np.float32)
        fitness = np.array(part.fitness)
        results = part.results()
        counted = self._failed_candidates(results)
        failed = None if counted is None else int(np.count_nonzero(counted | np.isnan(fitness)))
        found = Produced.of(genomes, results, fitness, self._population_fitness(), failed)
        return self._told(number, self._seeds, found)

    def _continue(
        self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None
    ) -> bool:
        stopped = False
        first = self._method.evaluations  # the backend counts from 0
        on_results = self._first.of_generation() if not first and backend.may_fail else None

        def feed(candidates: Sequence[int], results: Results) -> NDArray[np.float32] | None:
            nonlocal stopped
            rows = {candidate: row for row, candidate in enumerate(candidates)}
            results = self._failures.named(results, self._seeds, rows=rows, first=first)
            self._journal.extend(results.journal, first)
            if on_results is not None:
                on_results(candidates, results)
            for row, candidate in enumerate(candidates):
                self._early[first + candidate] = (results.fitness[row], results.metrics[row])
            while not self._method.done and self._method.evaluations in self._early:
                self._tell_first(*self._early.pop(self._method.evaluations))
                whole = len(self._part.genomes) == self._method.generation_size
                if whole or self._method.done:
                    stopped = not self._complete(on_generation)
                if stopped:
                    return None
            return None if self._method.done else self._weights(self._ask_all())

        self._check_first(self._method.generation_size)
        self._ask_all()
        done, whole = (count * len(self._seeds) for count in (first, self._account.most))
        self._announce(backend, None, (done, whole))  # several are under way
        controllers = Controllers.of(self._representation, np.array(self._flying, dtype=np.float32))
        with self._first_kept(0):
            backend.stream(controllers, self._seeds, feed, self._recorder.watched(on_progress))
        return stopped and not self._over and not self._method.done

    def _used_up(self) -> Ended:
        """Return which budget a method that is done has used."""
        last = self._budget.generations
        whole = last is not None and self._method.evaluations >= last * self._method.generation_size
        return "generations" if whole else "evaluations"

    def _fits(self, most: int) -> bool:
        """Return whether there are no more candidates than so many; the method keeps to whole generations."""
        return self._account.evaluations <= most

    def _complete(self, on_generation: OnGeneration | None) -> bool:
        """Store a generation; return whether to go on."""
        number = self._account.evaluations // self._method.generation_size
        fitness = np.array(self._part.fitness)
        journal, self._journal = self._journal, Journal()
        with self._recorder.journal_kept(number, journal):
            self._check(fitness, number, self._part.results())
        self._failures.tell()
        told = self._told_part()
        self._fitness_checks.add(number, told.found.results.fitness)
        goes_on = self._recorder.finish(told.evaluated(), journal, on_generation)
        self._over = goes_on and not self._method.done and self._account.time_is_over
        return goes_on and not self._over

    def _weights(self, genomes: list[Genome]) -> NDArray[np.float32]:
        rows = np.array(genomes, dtype=np.float32).reshape(-1, self._representation.genome_size)
        return np.ascontiguousarray(weights_of(self._representation, rows), dtype=np.float32)
