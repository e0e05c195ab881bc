"""What rankings share that evaluate some candidates in a second simulation, slow and closer to reality."""

import math
from abc import abstractmethod
from collections.abc import Generator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from swarmwright.common.arrays import Fitness
from swarmwright.common.problems import FieldError, format_value
from swarmwright.methods.rankings._base import Ranking, RankingOptions

METRIC = "slow_fitness"
"""The metric of the record that has the fitness in the slow simulation, NaN where a candidate has none."""
Episodes = NDArray[np.float64]

_MARGIN_SHARE = 2.0**-30
"""Share of a limit into which what is above it is moved; its precision leaves as much for differences."""
_SMALLEST = 2.0**-900
"""Limits nearer to zero have the margin of this."""


class Ranked(NamedTuple):
    """A generation whose candidates were evaluated, some of them in the slow simulation as well."""

    fitness: Fitness
    """(candidates,), NaN where a candidate failed."""
    learned: Any
    """What later generations need to know of it."""


Rounds = Generator[NDArray[np.intp], Episodes, Ranked]
"""Yields candidates for the slow simulation, takes what came out, (candidates, episodes)."""


def _target(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str | Mapping) and value:
        return value
    raise ValueError(f"must be a simulation, a file, or keys that differ, not {format_value(value)}")


class SlowOptions(RankingOptions):
    """Options of rankings with a second simulation."""

    slow: Annotated[
        Any,
        BeforeValidator(_target),
        WithJsonSchema({"anyOf": [{"type": "string", "minLength": 1}, {"type": "object"}]}),
    ] = Field()
    """The slow simulation: its name; a file (.yaml, relative to this one) with the keys of the experiment
    that differ; or such keys, {name: gazebo, simulation: arena-gazebo, servers: 4}. It has the same sensors
    and actuators. A file is read once and kept in the run."""

    @model_validator(mode="after")
    def _members(self) -> "SlowOptions":
        if self.reevaluate:
            raise FieldError(
                "reevaluate",
                "the fitness of members that stay is of two simulations; leave it out, or take "
                "kind: absolute",
            )
        return self


class SlowRanking(Ranking):
    """A ranking that evaluates some candidates in a second simulation.

    Episodes there have the same seeds. What is learned of generations is applied to later ones.
    """

    options: SlowOptions

    @property
    def descriptor(self) -> tuple[str, ...]:
        """Names of metrics of the fast simulation that it needs."""
        return ()

    @abstractmethod
    def expected(self, candidates: int) -> int:
        """Return how many candidates of a generation are evaluated in the slow simulation, most often."""

    @abstractmethod
    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:
        """Choose candidates of a generation, and rank it; changes nothing of what is known.

        Args:
            fast: (candidates, episodes) fitness in the experiment's own simulation, NaN where one failed.
            metrics: (candidates, episodes, metrics) there, those of `descriptor`.
        """

    @abstractmethod
    def learn(self, learned: Any) -> None:  # noqa: ANN401 - the ranking's own
        """Take over what is known after a generation."""

    def ranked(self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]) -> Fitness:
        """Return the fitness of a generation that was evaluated, and learn of it.

        slow: (candidates, episodes) fitness in the slow simulation, NaN where a candidate was not evaluated;
        the others as those of `rounds`.
        """
        found = self._passed(fast, slow, metrics)[0]
        self.learn(found.learned)
        return found.fitness

    def chosen(self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which candidates of a generation were evaluated in the slow simulation, (candidates,).

        Arguments as those of `ranked`, which is called later: it changes what is known.
        """
        return self._passed(fast, slow, metrics)[1]

    def _passed(
        self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]
    ) -> tuple[Ranked, NDArray[np.bool_]]:
        """Return a generation that was evaluated, and which candidates the slow simulation evaluated."""
        asked = np.zeros(len(fast), dtype=np.bool_)
        rounds = self.rounds(self.counted(fast), metrics)
        try:
            who = next(rounds)
            while True:
                asked[who] = True
                who = rounds.send(self.counted(slow[who]))
        except StopIteration as end:
            found: Ranked = end.value
            return found, asked

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate: every episode makes one."""
        return np.array(episodes, dtype=np.float64)

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return the means, the fitness in one simulation alone."""
        return np.array([row_means(np.array([row]))[0] for row in episodes])


def row_means(rows: Episodes) -> Fitness:
    """Return the mean of each row, added one after the other; NaN where a value is not finite."""
    if not rows.shape[0]:
        return np.empty(0)
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows has failed
        found: Fitness = np.add.accumulate(rows, axis=1)[:, -1] / rows.shape[1] + 0.0
    found[~np.isfinite(found)] = np.nan
    return found


def kept_below(values: Fitness, limit: float) -> Fitness:
    """Return values in the same order, all less than a finite limit; NaN stays.

    Those above it, and those just below, are moved into a margin of 2^-30 of the limit, by the logarithm of
    how far they are above its lower end. So those of several generations with the same limit are in order,
    too, and the best of them changes as it would without a limit.
    """
    margin = max(abs(limit), _SMALLEST) * _MARGIN_SHARE
    end = limit - margin
    moved = values > end
    distinct, places = np.unique(values[moved], return_inverse=True)
    with np.errstate(over="ignore"):  # infinity is far enough
        above = distinct - end
    # The bits of a positive number, read as an integer, are its logarithm, linear between powers of two.
    levels = end + margin * (above.view(np.int64) / 2.0**63)
    last = end
    for index, level in enumerate(levels.tolist()):
        last = max(level, math.nextafter(last, math.inf))
        levels[index] = last
    found = values.copy()
    found[moved] = np.minimum(levels, math.nextafter(limit, -math.inf))[places]
    return found
