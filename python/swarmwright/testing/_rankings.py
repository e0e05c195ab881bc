"""Checks of rankings."""

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright.methods.rankings import RANKINGS, Ranking
from swarmwright.testing._common import EXAMPLES, check_options

_SPREAD = np.array([0.0, 3.5, -1.25, 8.0, 0.5])
"""Results of a candidate's episodes, some far better than others."""
_NUMBERS = 4
"""Generations whose seeds are compared, or candidates in steady state."""
_LARGEST_SEED = 2**63 - 1


def check_ranking(kind: str) -> None:
    """Check a registered ranking with its default options and several numbers of episodes.

    Raises AssertionError with the violated rule.
    """
    check_options(RANKINGS, kind)
    component = RANKINGS.get(kind)
    for episodes in (1, 2, 5):
        for seeds in ("same", "new"):
            ranking = _ranking(component, episodes, seeds=seeds)
            if ranking is not None:
                _check_seeds(ranking)
        ranking = _ranking(component, episodes)
        assert ranking is not None
        _check_scores(ranking)
        _check_samples(ranking)
    reevaluating = _ranking(component, 2, reevaluate=True)
    if reevaluating is not None:
        scores = _plain(reevaluating, [[1.0, 2.0], [3.0, 4.0, 3.5, 4.5]])
        assert np.isfinite(scores).all(), "with reevaluate, _score must take rows of different length"


def _ranking(component: type[Ranking], episodes: int, **options: object) -> Ranking | None:
    """Create a ranking with options; return None if it refuses them."""
    values = {**EXAMPLES.get(component.kind, {}), "episodes": episodes}
    try:
        return component(component.options_model.model_validate({**values, **options}))
    except ValidationError:
        if not options:
            raise
        return None


def _check_seeds(ranking: Ranking) -> None:
    """Check the seeds of episodes: in range, different, and equal to `ranking.seeds`."""
    episodes, new = ranking.options.episodes, ranking.options.seeds == "new"
    several = [ranking.seeds_of(7, number) for number in range(_NUMBERS)]
    for number, seeds in enumerate(several):
        assert len(seeds) == episodes, f"seeds_of must return {episodes} seed(s), one for each episode"
        assert len(set(seeds)) == episodes, "episodes must have different seeds"
        assert all(0 <= seed <= _LARGEST_SEED for seed in seeds), "seeds must be from 0 to 2**63 - 1"
        assert seeds == ranking.seeds_of(7, number), "seeds_of must return the same seeds each time"
        expected = several[number if new else 0]
        assert ranking.seeds(7, number) == expected, (
            "seeds must be those of seeds_of, by generation with `seeds: new`, else of number 0"
        )
    every = [seed for seeds in several for seed in seeds]
    assert len(set(every)) == len(every), "seeds of different numbers must have none in common"


def _check_scores(ranking: Ranking) -> None:
    episodes = ranking.options.episodes
    even = np.arange(4 * episodes, dtype=np.float64).reshape(4, episodes) - 6
    uneven = _SPREAD[:episodes] + np.array([[-6.0], [-1.0], [0.5], [9.0]])
    for results in (even, uneven):
        scores = ranking.score(results)
        assert scores.dtype == np.float64, "fitness must be float64"
        assert scores.shape == (4,), "there must be a fitness for each candidate"
        assert (np.diff(scores) > 0).all(), "better by the same in every episode must be better"
        assert np.array_equal(scores, ranking.score(results)), "the same results must have the same fitness"
        by_array = np.asarray(ranking._score_array(results), dtype=np.float64)
        assert np.allclose(by_array, _plain(ranking, results.tolist()), rtol=1e-9, atol=1e-12), (
            "_score and _score_array must return the same"
        )
        if type(ranking).score is Ranking.score:  # a race, for one, compares candidates
            alone = [ranking.score(results[[row]])[0] for row in range(4)]
            assert np.allclose(scores, alone, rtol=1e-9, atol=1e-12), (
                "the fitness of a candidate must not depend on the others"
            )
    broken = even.copy()
    broken[1, -1] = np.nan
    broken[2, 0] = np.inf
    failed = ranking.score(broken)
    assert np.isnan(failed[[1, 2]]).all(), "a candidate with a failed episode must have failed"
    assert np.isfinite(failed[[0, 3]]).all(), "others must not suffer from a failed candidate"
    assert ranking.score(np.empty((0, episodes))).shape == (0,), "no candidates must have no fitness"


def _check_samples(ranking: Ranking) -> None:
    """Check the values of a candidate for validation."""
    results = [*_SPREAD, *(_SPREAD + 1), *(_SPREAD - 2), *_SPREAD]
    samples = ranking.samples(results)
    assert isinstance(samples, np.ndarray), "samples must return an array"
    assert samples.dtype == np.float64, "samples must be float64"
    assert samples.ndim == 1, "samples must return (samples,) values"
    least = len(results) // ranking.options.episodes
    assert len(samples) >= least, f"samples must make {least} values or more of {len(results)} episodes"
    assert np.isfinite(samples).all(), "samples of finite results must be finite"
    assert np.array_equal(samples, ranking.samples(results)), "the same results must have the same samples"


def _plain(ranking: Ranking, rows: list[list[float]]) -> NDArray[np.float64]:
    """Return the results of `_score` as plain values."""
    scores = np.asarray(ranking._score(rows), dtype=np.float64)
    assert scores.shape == (len(rows),), "_score must return a fitness for each candidate"
    return scores
