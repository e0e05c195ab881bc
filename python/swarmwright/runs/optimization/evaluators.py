"""Evaluators, which evaluate and rank a generation: completely, in a race, or in two simulations."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.race import Race
from swarmwright.methods.rankings.slow_simulation import SlowRanking
from swarmwright.runs.optimization.two_simulations import TwoSimulations, find_descriptor_columns
from swarmwright.servers.evaluation.base import Backend, Controllers, OnResults, Progress, Results
from swarmwright.servers.rows import Journal


class Evaluator:
    """Evaluates every candidate of a generation in every episode, in one simulation.

    ranking: ranking of the run.
    """

    def __init__(self, ranking: Ranking) -> None:
        self._ranking = ranking

    def evaluate(
        self,
        backend: Backend,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Evaluate a generation; arguments as for `Backend.evaluate`."""
        return backend.evaluate(controllers, seeds, on_progress, meanwhile, on_results)

    def fitness(self, results: Results, genomes: Genomes) -> Fitness:
        """Return the fitness of a generation's candidates, computed by the ranking."""
        return self._ranking.score(results.fitness, genomes)

    def find_failed_candidates(self, results: Results) -> NDArray[np.bool_]:
        """Return which candidates failed in an episode, (candidates,).

        Call it before `fitness`, which may change the state of the ranking.
        """
        return np.asarray(self.find_failed_episodes(results).any(axis=1))

    def explain_failure(self, results: Results) -> str:
        """Explain candidates that failed without a failed episode; empty if another reason is known."""
        if results.journal.errors or self.find_failed_episodes(results).any():
            return ""
        return (
            ": all of their episodes succeeded, but the ranking's result is not finite, for example a sum "
            "beyond the range of binary64, or the result of a plug-in"
        )

    def find_failed_episodes(self, results: Results) -> NDArray[np.bool_]:
        """Return which episodes failed, (candidates, episodes)."""
        return ~np.isfinite(results.fitness)


class RaceEvaluator(Evaluator):
    """Evaluates in rounds; candidates that are dropped run only some of their episodes."""

    def __init__(self, ranking: Race) -> None:
        super().__init__(ranking)
        self._race = ranking

    def evaluate(
        self,
        backend: Backend,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Evaluate a generation; NaN for episodes that failed or were not run."""
        count, whole = len(controllers.weights), len(controllers.weights) * len(seeds)
        fitness = np.full((count, len(seeds)), np.nan)
        metrics = np.full((count, len(seeds), len(backend.metrics)), np.nan)
        journal = Journal()
        rounds = self._race.rounds(count)
        rows, episodes = next(rounds)
        while True:
            is_whole = len(rows) == count
            part = Controllers(
                controllers.architecture,
                controllers.weights if is_whole else np.ascontiguousarray(controllers.weights[rows]),
                controllers.sample if is_whole else None,
            )
            before = episodes.start * count

            def progress(done: int, _: int, waiting_for: str, before: int = before) -> None:
                on_progress(before + done, whole, waiting_for)

            results = backend.evaluate(part, seeds[episodes], progress, meanwhile, on_results)
            meanwhile = on_results = None
            fitness[rows, episodes] = results.fitness
            metrics[rows, episodes] = results.metrics
            journal.extend(results.journal.renumber(rows.tolist(), episodes.start))
            try:
                rows, episodes = rounds.send(results.fitness)
            except StopIteration:
                on_progress(whole, whole, "")
                return Results(fitness, metrics, journal)

    def find_failed_episodes(self, results: Results) -> NDArray[np.bool_]:
        """Return which of the episodes that were run failed, (candidates, episodes)."""
        failed = super().find_failed_episodes(results)
        return failed & (
            np.arange(failed.shape[1]) < self._race.count_episodes(results.fitness)[:, np.newaxis]
        )


class TwoSimulationsEvaluator(Evaluator):
    """Evaluates in the experiment's simulation, and some candidates also in the ranking's slow simulation.

    Args:
        ranking: ranking of the run.
        descriptor: columns of the fast simulation's metrics that the ranking needs.
    """

    def __init__(self, ranking: SlowRanking, descriptor: list[int]) -> None:
        super().__init__(ranking)
        self._slow = ranking
        self._descriptor = descriptor

    def evaluate(
        self,
        backend: Backend,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Evaluate a generation; the last metric is the fitness in the slow simulation, NaN without one."""
        assert isinstance(backend, TwoSimulations)
        ranking, count, episodes = self._slow, len(controllers.weights), len(seeds)
        whole = (count + ranking.count_transfers(count)) * episodes
        done = 0

        def progress(part: int, _: int, waiting_for: str) -> None:
            on_progress(min(done + part, whole - 1), whole, waiting_for)

        fast = backend.fast.evaluate(controllers, seeds, progress, meanwhile, on_results)
        slow = np.full((count, episodes), np.nan)
        journal = Journal()
        journal.extend(fast.journal)
        rounds = ranking.rounds(ranking.replace_failures(fast.fitness), fast.metrics[:, :, self._descriptor])
        done = count * episodes
        try:
            rows = next(rounds)
            while True:
                part = Controllers(controllers.architecture, np.ascontiguousarray(controllers.weights[rows]))
                results = backend.slow.evaluate(part, seeds, progress)
                done += len(rows) * episodes
                slow[rows] = results.fitness
                journal.extend(_prefix_warnings(results.journal, backend.name).renumber(rows.tolist()))
                rows = rounds.send(ranking.replace_failures(results.fitness))
        except StopIteration:
            on_progress(whole, whole, "")
        metrics = np.concatenate([fast.metrics, slow[:, :, np.newaxis]], axis=2)
        return Results(fast.fitness, np.ascontiguousarray(metrics), journal)

    def find_failed_candidates(self, results: Results) -> NDArray[np.bool_]:
        """Return which candidates failed in an episode of either simulation."""
        slow, descriptor = results.metrics[:, :, -1], results.metrics[:, :, self._descriptor]
        chosen = self._slow.find_transferred(results.fitness, slow, descriptor)
        return super().find_failed_candidates(results) | (chosen & ~np.isfinite(slow).all(axis=1))

    def fitness(self, results: Results, genomes: Genomes) -> Fitness:  # noqa: ARG002 - of the base class
        """Return the ranking's fitness from both simulations; see `Evaluator.fitness`."""
        descriptor = results.metrics[:, :, self._descriptor]
        return self._slow.rank(results.fitness, results.metrics[:, :, -1], descriptor)


def create_evaluator(ranking: Ranking, experiment: Experiment) -> Evaluator:
    """Create the evaluator that a ranking needs."""
    if isinstance(ranking, SlowRanking):
        return TwoSimulationsEvaluator(ranking, find_descriptor_columns(ranking, experiment))
    if isinstance(ranking, Race):
        return RaceEvaluator(ranking)
    return Evaluator(ranking)


def _prefix_warnings(journal: Journal, name: str) -> Journal:
    """Return a journal whose warnings begin with the name of the simulation."""
    warnings = [
        warning._replace(text=f"{name}: {warning.text}", episode=None) for warning in journal.warnings
    ]
    return Journal(journal.attempts, warnings)
