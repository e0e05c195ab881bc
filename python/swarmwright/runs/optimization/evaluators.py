"""How a generation is evaluated and ranked: as a whole, in a race, or in two simulations."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.race import Race
from swarmwright.methods.rankings.slow_simulation import SlowRanking
from swarmwright.runs.optimization.raced import race
from swarmwright.runs.optimization.two_simulations import TwoSimulations, descriptor_columns, evaluate_both
from swarmwright.servers.evaluation.base import Backend, Controllers, OnResults, Progress, Results


class Evaluator:
    """Evaluates every candidate of a generation in every episode, in one simulation.

    ranking: of the run.
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
        """Evaluate a generation; arguments as those of `Backend.evaluate`."""
        return backend.evaluate(controllers, seeds, on_progress, meanwhile, on_results)

    def fitness(self, results: Results, genomes: Genomes) -> Fitness:
        """Return what the ranking makes of the results of a generation."""
        return self._ranking.score(results.fitness, genomes)

    def failed_candidates(self, results: Results) -> NDArray[np.bool_]:
        """Return which candidates failed in an episode, (candidates,).

        Called before `fitness`, from which a ranking may learn.
        """
        return np.asarray(self.failed_episodes(results).any(axis=1))

    def why_failed(self, results: Results) -> str:
        """Return why candidates failed none of whose episodes did; empty where another reason is known."""
        if results.journal.errors or self.failed_episodes(results).any():
            return ""
        return (
            ": all of their episodes worked, but what the ranking makes of them is not finite, such as "
            "a sum beyond binary64, or what a plug-in returned"
        )

    def failed_episodes(self, results: Results) -> NDArray[np.bool_]:
        """Return which episodes failed, (candidates, episodes)."""
        return ~np.isfinite(results.fitness)


class RaceEvaluator(Evaluator):
    """Evaluates in rounds; candidates that are dropped go through some of their episodes only."""

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
        """Evaluate a generation; see `Evaluator.evaluate`."""
        return race(self._race, backend, controllers, seeds, on_progress, meanwhile, on_results)

    def failed_episodes(self, results: Results) -> NDArray[np.bool_]:
        """Return which episodes failed, of those that candidates went through."""
        failed = super().failed_episodes(results)
        return failed & (np.arange(failed.shape[1]) < self._race.ran(results.fitness)[:, np.newaxis])


class TwoSimulationsEvaluator(Evaluator):
    """Evaluates in the experiment's simulation, and some candidates in the ranking's slow one as well.

    Args:
        ranking: of the run.
        descriptor: which metrics of the fast simulation the ranking needs.
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
        """Evaluate a generation; see `Evaluator.evaluate`."""
        assert isinstance(backend, TwoSimulations)
        both = self._slow, self._descriptor, backend
        return evaluate_both(*both, controllers, seeds, on_progress, meanwhile, on_results)

    def failed_candidates(self, results: Results) -> NDArray[np.bool_]:
        """Return which candidates failed in an episode of either simulation."""
        slow, descriptor = results.metrics[:, :, -1], results.metrics[:, :, self._descriptor]
        chosen = self._slow.chosen(results.fitness, slow, descriptor)
        return super().failed_candidates(results) | (chosen & ~np.isfinite(slow).all(axis=1))

    def fitness(self, results: Results, genomes: Genomes) -> Fitness:  # noqa: ARG002 - of the base class
        """Return what the ranking makes of both fitnesses; see `Evaluator.fitness`."""
        descriptor = results.metrics[:, :, self._descriptor]
        return self._slow.ranked(results.fitness, results.metrics[:, :, -1], descriptor)


def evaluator_of(ranking: Ranking, experiment: Experiment) -> Evaluator:
    """Return the evaluator that a ranking needs."""
    if isinstance(ranking, SlowRanking):
        return TwoSimulationsEvaluator(ranking, descriptor_columns(ranking, experiment))
    if isinstance(ranking, Race):
        return RaceEvaluator(ranking)
    return Evaluator(ranking)
