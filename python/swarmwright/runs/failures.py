"""Failed evaluations and episodes in the record of a run."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.methods.rankings.race import Race

if TYPE_CHECKING:
    from swarmwright.methods.rankings import Ranking
    from swarmwright.runs.run import Run
    from swarmwright.servers.rows import GenerationResult


class EpisodeCounts(NamedTuple):
    """Numbers of episodes that the candidates of a generation ran."""

    generation: int
    episodes: NDArray[np.int64]
    """Number of episodes, (candidates,)."""
    failed: NDArray[np.int64]
    """Number of failed episodes, (candidates,)."""


def iterate_episode_counts(run: "Run") -> Iterator[EpisodeCounts]:
    """Yield the counts of each generation of a run; all evaluations are read."""
    ranking = run.experiment.new_ranking()
    for result in run._store.generations():
        yield count_episodes(result, ranking)


def count_episodes(result: "GenerationResult", ranking: "Ranking") -> EpisodeCounts:
    """Count the episodes of a generation; ranking: ranking of the run."""
    failed = ~np.isfinite(result.episodes)
    lengths = np.full(len(failed), failed.shape[1], np.int64)
    if isinstance(ranking, Race):
        lengths = ranking.count_episodes(result.episodes)
        failed &= np.arange(failed.shape[1]) < lengths[:, np.newaxis]
    return EpisodeCounts(result.generation, lengths, failed.sum(axis=1))


def count_failed_evaluations(run: "Run", evaluations: int) -> int:
    """Return how many of a run's first evaluations failed."""
    count = 0
    begin = 0
    for summary in run.history:
        if summary.evaluations > evaluations:
            break
        count, begin = count + summary.failed, summary.evaluations
    else:
        return count
    if begin == evaluations or not summary.failed:
        return count
    ranking = run.experiment.new_ranking()
    for result in run._store.read_generation(summary.generation):
        failed = (count_episodes(result, ranking).failed > 0) | ~np.isfinite(result.fitness)
        count += int(np.count_nonzero(failed[: evaluations - begin]))
    return count
