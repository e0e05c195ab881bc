"""Seeds of the episodes of an evaluation."""

from typing import Any

import numpy as np

from swarmwright.common.errors import InputError, PlugInError
from swarmwright.common.plug_in_code import is_plug_in, locate_method
from swarmwright.common.untrusted import escape_line
from swarmwright.methods.rankings import Ranking


def check_seeds(ranking: Ranking, seeds: Any) -> list[int]:  # noqa: ANN401 - whatever a plug-in returns
    """Return the seeds as integers. Raises PlugInError if a plug-in returns other values."""
    if not is_plug_in(type(ranking)):
        return list(seeds)
    ok = isinstance(seeds, list | tuple | range | np.ndarray) and len(seeds) > 0
    if not ok or not all(isinstance(value, int | np.integer) and 0 <= value < 2**63 for value in seeds):
        raise PlugInError(
            f"{locate_method(ranking, 'seeds')}: returned {escape_line(repr(seeds)[:100])}; expected a list "
            "of at least "
            "one integer, the seeds of the episodes"
        )
    return [int(seed) for seed in seeds]


def seeds_of(ranking: Ranking, first: int, generation: int) -> list[int]:
    """Return the seeds of a generation.

    first: `parameters.seed`. Raises InputError for a generation without valid seeds, PlugInError as
    `check_seeds`.
    """
    if generation < 0:
        raise InputError(f"generation: must be at least 0, not {generation}")
    seeds = check_seeds(ranking, ranking.seeds(first, generation))
    if max(seeds) >= 2**63:
        raise InputError(f"generation: {generation} is too large; its seeds would exceed 2**63 - 1")
    return seeds
