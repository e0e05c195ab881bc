"""A race in each generation: candidates that are clearly worse go through no more episodes."""

import math
import sys
from collections.abc import Generator, Sequence
from contextlib import suppress
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright.common import statistics
from swarmwright.common.typing import Fitness
from swarmwright.methods.rankings._base import Ranking, RankingOptions
from swarmwright.methods.rankings.race_tests import Test, survivors

Episodes = NDArray[np.float64]
_LARGEST_FLOAT = sys.float_info.max
"""Of binary64: fitness is kept finite."""
Rounds = Generator[tuple[NDArray[np.intp], slice], Episodes, Fitness]
"""Yields candidates and the episodes that they go through, takes what came out; returns their fitness."""


class RaceOptions(RankingOptions):
    """Candidates that are significantly worse than the best of their generation get no more episodes.

    Not with `map_elites` and `nsga2`: metrics that they compare would be means over different seeds.
    """

    kind: Literal["race"] = "race"
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Episodes of a candidate that is not dropped: more than first_test in an experiment."""
    first_test: int = Field(default=5, ge=2, le=100_000)
    """Episodes of all candidates, after which the first test is made."""
    each_test: int = Field(default=1, ge=1, le=100_000)
    """Episodes between two tests."""
    test: Test = "friedman"
    """friedman: Friedman's test and Conover's comparisons with the best, by ranks. t, t_holm, t_bonferroni:
    paired t-tests with the best mean, without or with a correction for their number."""
    level: float = Field(default=0.05, gt=0, lt=1)
    """Significance level of each test."""

    @model_validator(mode="after")
    def _members(self) -> "RaceOptions":
        if self.reevaluate:
            raise ValueError(
                "reevaluate: members that stay have other episodes than new candidates, which cannot race "
                "with them; leave reevaluate out, or take kind: absolute"
            )
        return self


class Race(Ranking):
    """The mean of a candidate's episodes, of which the clearly worse have fewer.

    After `first_test` episodes of all candidates, and then every `each_test` ones, those that are
    significantly worse than the best of the generation are dropped: they go through no more episodes. A
    candidate of which an episode fails is dropped at once, unless `failed` gives that a fitness.

    The fitness of a candidate with all episodes is their mean. For one that was dropped it is the mean of
    those that it has, plus how much higher the mean of all episodes is than that of the same ones among the
    candidates that have them all, so that easy seeds do not count; and less than the least fitness of those
    that were dropped later.

    Source: Birattari, Stützle, Paquete and Varrentrapp, "A racing algorithm for configuring metaheuristics",
    GECCO 2002.
    """

    kind: ClassVar[str] = "race"
    options_model = RaceOptions
    options: RaceOptions

    def ran(self, episodes: Episodes) -> NDArray[np.int64]:
        """Return how many episodes each candidate of a generation went through, (candidates,).

        episodes: the results of the whole generation, (candidates, episodes).
        """
        found = np.zeros(len(episodes), dtype=np.int64)
        with suppress(StopIteration):
            rounds = self.rounds(len(episodes))
            who, which = next(rounds)
            while True:
                found[who] = which.stop
                who, which = rounds.send(episodes[who, which])
        return found

    def rounds(self, candidates: int) -> Rounds:
        """Race so many candidates, at least one; see `Rounds`. NaN or infinite: the episode has failed."""
        options, count = self.options, self.options.episodes
        episodes = np.full((candidates, count), np.nan)
        alive = np.arange(candidates)
        length = np.zeros(candidates, dtype=np.int64)
        done, failed = 0, np.zeros(candidates, dtype=np.bool_)
        while done < count and len(alive):
            upto = min(options.first_test if not done else done + options.each_test, count)
            values = self.counted((yield alive, slice(done, upto)))
            episodes[alive, done:upto] = values
            length[alive] = upto
            whole = np.isfinite(values).all(axis=1)
            failed[alive[~whole]] = True
            alive, done = alive[whole], upto
            if done < count and len(alive) > 1:
                scores = _compared(episodes[alive, :done].T, options.test)
                alive = alive[survivors(scores, options.test, options.level)]
        return self._fitness(episodes, length, failed)

    def score(self, episodes: Episodes, genomes: NDArray[np.float32] | None = None) -> Fitness:  # noqa: ARG002
        """Return (candidates,) fitness of (candidates, episodes) results; NaN where a candidate failed.

        Episodes that a candidate does not go through, because it is dropped before, do not count.
        """
        if not len(episodes):
            return np.empty(0)
        rounds = self.rounds(len(episodes))
        try:
            who, which = next(rounds)
            while True:
                who, which = rounds.send(episodes[who, which])
        except StopIteration as end:
            fitness: Fitness = end.value
            return fitness

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate: every episode makes one."""
        return np.array(episodes, dtype=np.float64)

    def _fitness(self, episodes: Episodes, length: NDArray[np.int64], failed: NDArray[np.bool_]) -> Fitness:
        fitness = np.full(len(episodes), np.nan)
        # Those that were left may all have failed in the end.
        longest = int(length[~failed].max(initial=0))
        leading = ~failed & (length == longest)
        with np.errstate(over="ignore"):  # of what is cut off at the largest number
            reference = _mean(episodes[leading, :longest]) if longest else np.empty(0)
            least = np.inf
            for upto in sorted(set(length[~failed].tolist()), reverse=True):
                rows = np.flatnonzero(~failed & (length == upto))
                own = _mean(episodes[rows, :upto])
                if leading[rows[0]]:
                    values = own
                else:
                    easier = np.clip(
                        reference - _mean(episodes[leading, :upto]), -_LARGEST_FLOAT, _LARGEST_FLOAT
                    )
                    values = np.clip(own + _mean(easier[np.newaxis])[0], -_LARGEST_FLOAT, _below(least))
                fitness[rows] = values + 0.0
                least = min(least, float(np.min(values)))
        return fitness

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return the means: what candidates have that no others raced with."""
        return np.array([_mean(np.array([row]))[0] for row in episodes])


def _below(value: float) -> float:
    """Return the next smaller number; of the least one, and of what is not finite, the same."""
    return max(math.nextafter(value, -math.inf), -_LARGEST_FLOAT) if math.isfinite(value) else value


def _compared(scores: Episodes, test: Test) -> Episodes:
    """Return scores whose differences are finite, in a t-test their squares, too.

    What a test finds does not depend on a factor, which is a power of two and therefore exact.
    """
    most = 1000 if test == "friedman" else 400
    exponent = int(np.frexp(np.abs(scores).max())[1])
    found: Episodes = np.ldexp(scores, most - exponent) if exponent > most else scores
    return found


def _mean(rows: Episodes) -> Fitness:
    """Return the mean of each row, added one after the other."""
    with np.errstate(over="ignore", invalid="ignore"):
        found: Fitness = np.add.accumulate(rows, axis=1)[:, -1] / rows.shape[1]
    # Where the sum is too large, the mean is not.
    for row in np.flatnonzero(~np.isfinite(found) & np.isfinite(rows).all(axis=1)):
        found[row] = statistics.mean(rows[row].tolist())
    return found
