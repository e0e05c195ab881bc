"""The strategy of competitions: the candidates of a generation meet in rounds of matches.

A row of the record is a match: its genome holds the controllers of all sides, and its fitness is that of the
first side. Further columns of metrics say which candidates met, with the fitness and the score of each side.
The last row of a generation is the match of its champions.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmwright.methods.competition import Competition, Matches
from swarmwright.methods.rankings.tournament import Tournament
from swarmwright.runs.matches import COLUMNS, SideFitness
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Controllers, Results, check_seeds
from swarmwright.servers.rows import GenerationResult, Journal


class Competing(Strategy):
    """Plays the matches of a generation, and tells each population's method its scores."""

    stores_later = True

    def __init__(self, loop: Loop) -> None:
        super().__init__(loop)
        assert isinstance(loop.method, Competition)
        assert isinstance(loop.ranking, Tournament)
        self._competition = loop.method
        self._sides = SideFitness(loop.ranking.options)

    def fits(self, most: int) -> bool:
        """Return whether the largest possible next generation fits; see `Strategy.fits`."""
        return self.loop.account.evaluations + self._competition.most_matches <= most

    def advance(self, backend: Backend) -> None:
        """Play the next generation."""
        loop, competition = self.loop, self._competition
        number = competition.generation
        loop.announce(backend, number)
        seeds = self._seeds()
        whole = max(competition.most_matches, 1) * len(seeds)
        played: list[tuple[Matches, Results]] = []
        rounds = competition.matches()
        matches = next(rounds)
        done = 0
        while True:
            before = done * len(seeds)

            def progress(part: int, _: int, waiting_for: str, before: int = before) -> None:
                loop.recorder.progress(min(before + part, whole), whole, waiting_for)

            controllers = Controllers.from_genomes(loop.representation, matches.genomes)
            if played:
                results = backend.evaluate(controllers, seeds, progress)
            else:
                with loop.first_evaluations(number) as on_results:
                    results = backend.evaluate(
                        controllers, seeds, progress, loop.recorder.store_last, on_results
                    )
            played.append((matches, results))
            done += len(matches.candidates)
            try:
                fitness, _ = self._sides(backend.metrics, results)
                matches = rounds.send(self._mean(fitness))
            except StopIteration:
                break
        results = _concatenate([part for _, part in played])
        lineup = Matches(
            np.concatenate([part.candidates for part, _ in played]),
            np.concatenate([part.genomes for part, _ in played]),
        )
        results = self._with_columns(backend.metrics, lineup, results)
        results = loop.failures.add_warnings(results, seeds, number)
        loop.complete(results, lambda: self._tell(lineup, seeds, results))

    def replay_generation(self, stored: GenerationResult) -> bool:
        """Play a stored generation again from its results; see `Strategy.replay_generation`."""
        seeds = self._seeds()
        genomes, columns = stored.expand_genomes(), len(COLUMNS) * self._competition.sides
        fitness = stored.metrics[:, :, -columns:].reshape(*stored.episodes.shape, -1, len(COLUMNS))[..., 1]
        means = self._mean(fitness)
        rounds = self._competition.matches()
        matches = next(rounds)
        parts, first = [], 0
        while True:
            last = first + len(matches.candidates)
            if matches.genomes.tobytes() != genomes[first:last].tobytes():
                return False
            parts.append(matches.candidates)
            try:
                matches = rounds.send(means[first:last])
            except StopIteration:
                break
            first = last
        if last != len(genomes) or seeds != stored.seeds:
            return False
        lineup = Matches(np.concatenate(parts), genomes)
        results = Results(stored.episodes, stored.metrics, Journal())
        return self._tell(lineup, seeds, results).fitness.tobytes() == stored.fitness.tobytes()

    def _seeds(self) -> list[int]:
        ranking = self.loop.ranking
        return check_seeds(ranking, ranking.seeds(self.loop.first_seed, self._competition.generation))

    def _tell(self, lineup: Matches, seeds: list[int], results: Results) -> GenerationResult:
        loop = self.loop
        fitness = loop.ranking.score(results.fitness)
        loop.check(fitness, results)
        failed = int(np.count_nonzero(~np.isfinite(results.fitness).all(axis=1)))
        self._competition.finish()
        champions = len(lineup.candidates) - 1
        return loop.record_generation(
            lineup.genomes, seeds, results, fitness, failed=failed, outcome=(champions, failed)
        )

    def _mean(self, fitness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean fitness of each side over the episodes, (matches, sides); NaN after failures."""
        replaced = self.loop.ranking.replace_failures(fitness)
        total = np.zeros((replaced.shape[0], replaced.shape[2]))
        for episode in range(replaced.shape[1]):  # in this order whatever the layout in memory
            total += replaced[:, episode]
        return np.asarray(total / replaced.shape[1])

    def _with_columns(self, names: Sequence[str], lineup: Matches, results: Results) -> Results:
        """Return results with the columns of all sides after the metrics."""
        fitness, warnings = self._sides(names, results)
        columns = np.empty((*fitness.shape, len(COLUMNS)))
        columns[..., 0] = lineup.candidates[:, np.newaxis]
        columns[..., 1] = fitness
        columns[..., 2] = self._competition.scores_of(lineup)[:, np.newaxis]
        metrics = np.concatenate([results.metrics, columns.reshape(*results.fitness.shape, -1)], axis=2)
        journal = results.journal.with_warnings(warnings)
        return Results(np.ascontiguousarray(fitness[..., 0]), np.ascontiguousarray(metrics), journal)


def _concatenate(parts: Sequence[Results]) -> Results:
    """Return the results of all rounds, with the matches in order."""
    journal, first = Journal(), 0
    for part in parts:
        journal.extend(part.journal.renumber(range(first, first + len(part.fitness))))
        first += len(part.fitness)
    return Results(
        np.concatenate([part.fitness for part in parts]),
        np.concatenate([part.metrics for part in parts]),
        journal,
    )
