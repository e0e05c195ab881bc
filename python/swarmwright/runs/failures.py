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


class Taken(NamedTuple):
    """Episodes that the candidates of a generation went through."""

    generation: int
    episodes: NDArray[np.int64]
    """(candidates,) how many."""
    failed: NDArray[np.int64]
    """(candidates,) how many of these failed."""


def taken(run: "Run") -> Iterator[Taken]:
    """Yield each generation of a run; every evaluation is read."""
    ranking = run.experiment.new_ranking()
    for evaluated in run._store.generations():
        yield taken_in(evaluated, ranking)


def taken_in(evaluated: "GenerationResult", ranking: "Ranking") -> Taken:
    """Return the episodes of a generation; ranking: of the run."""
    failed = ~np.isfinite(evaluated.episodes)
    lengths = np.full(len(failed), failed.shape[1], np.int64)
    if isinstance(ranking, Race):
        lengths = ranking.count_episodes(evaluated.episodes)
        failed &= np.arange(failed.shape[1]) < lengths[:, np.newaxis]
    return Taken(evaluated.generation, lengths, failed.sum(axis=1))


def failed_within(run: "Run", evaluations: int) -> int:
    """Return how many of the first so many evaluations of a run failed."""
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
    for evaluated in run._store.read_generation(summary.generation):
        some = (taken_in(evaluated, ranking).failed > 0) | ~np.isfinite(evaluated.fitness)
        count += int(np.count_nonzero(some[: evaluations - begin]))
    return count
