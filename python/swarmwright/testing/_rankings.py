"""Checks of rankings."""

import numpy as np

from swarmwright.rankings import RANKINGS
from swarmwright.testing._common import EXAMPLES, check_options


def check_ranking(kind: str) -> None:
    """Check a registered ranking with its default options and several numbers of episodes."""
    check_options(RANKINGS, kind)
    component = RANKINGS.get(kind)
    given = EXAMPLES.get(kind, {})
    for episodes in (1, 2, 5):
        ranking = component(component.options_model.model_validate({**given, "episodes": episodes}))
        seeds = ranking.seeds(7)
        assert len(seeds) == episodes
        assert len(set(seeds)) == episodes, "episodes must have different seeds"
        results = np.arange(4 * episodes, dtype=np.float64).reshape(4, episodes) - 6
        scores = ranking.score(results)
        assert scores.dtype == np.float64
        assert scores.shape == (4,)
        assert (np.diff(scores) > 0).all(), "better in every episode must be better"
        broken = results.copy()
        broken[1, -1] = np.nan
        broken[2, 0] = np.inf
        failed = ranking.score(broken)
        assert np.isnan(failed[[1, 2]]).all(), "a candidate with a failed episode must have failed"
        assert np.isfinite(failed[[0, 3]]).all(), "others must not suffer from a failed candidate"
        assert ranking.score(np.empty((0, episodes))).shape == (0,)
