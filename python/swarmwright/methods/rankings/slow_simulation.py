"""The common base of rankings with a second, slow and more realistic simulation."""

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
"""Metric of the record with the fitness in the slow simulation, NaN without one."""
Episodes = NDArray[np.float64]

_MARGIN_SHARE = 2.0**-30
"""Share of a limit that serves as margin for values above it."""
_SMALLEST = 2.0**-900
"""Smallest magnitude of a limit for its margin."""


class Ranked(NamedTuple):
    """The result of ranking a generation."""

    fitness: Fitness
    """(candidates,), NaN where a candidate failed."""
    learned: Any
    """Knowledge for later generations."""


Rounds = Generator[NDArray[np.intp], Episodes, Ranked]
"""Yields candidates for the slow simulation and receives their results, (candidates, episodes)."""


def _parse_target(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str | Mapping) and value:
        return value
    raise ValueError(
        f"must be a simulation, a file or a mapping of differing keys, not {format_value(value)}"
    )


class SlowOptions(RankingOptions):
    """Options of rankings with a second simulation."""

    slow: Annotated[
        Any,
        BeforeValidator(_parse_target),
        WithJsonSchema({"anyOf": [{"type": "string", "minLength": 1}, {"type": "object"}]}),
    ] = Field()
    """The slow simulation, with the same sensors and actuators: its name, keys that differ from the
    experiment ({name: gazebo, simulation: arena-gazebo, servers: 4}), or a .yaml file with them.
    """

    @model_validator(mode="after")
    def _members(self) -> "SlowOptions":
        if self.reevaluate:
            raise FieldError(
                "reevaluate",
                "survivors have fitness from two simulations; leave it out, or use kind: absolute",
            )
        return self


class SlowRanking(Ranking):
    """A ranking that evaluates some candidates in a second simulation.

    Its episodes have the same seeds. Knowledge from generations is applied to later ones.
    """

    options: SlowOptions

    @property
    def descriptor(self) -> tuple[str, ...]:
        """Names of metrics of the fast simulation that it needs."""
        return ()

    @abstractmethod
    def count_transfers(self, candidates: int) -> int:
        """Return the usual number of candidates to evaluate in the slow simulation."""

    @abstractmethod
    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:
        """Choose candidates of a generation and rank it, without changing the state.

        Args:
            fast: (candidates, episodes) fitness in the experiment's simulation, NaN for failed episodes.
            metrics: (candidates, episodes, metrics) of the experiment's simulation, those of `descriptor`.
        """

    @abstractmethod
    def learn(self, learned: Any) -> None:  # noqa: ANN401 - the ranking's own
        """Store the knowledge from a generation."""

    def rank(self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]) -> Fitness:
        """Return the fitness of an evaluated generation, and learn from it.

        slow: (candidates, episodes) fitness in the slow simulation, NaN for candidates without; other
        arguments as in `rounds`.
        """
        ranked = self._replay(fast, slow, metrics)[0]
        self.learn(ranked.learned)
        return ranked.fitness

    def find_transferred(
        self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which candidates of a generation were evaluated in the slow simulation, (candidates,).

        Arguments as in `ranked`; call it before `ranked`, which changes the state.
        """
        return self._replay(fast, slow, metrics)[1]

    def _replay(
        self, fast: Episodes, slow: Episodes, metrics: NDArray[np.float64]
    ) -> tuple[Ranked, NDArray[np.bool_]]:
        """Replay the rounds of a generation; return it and which candidates the slow simulation evaluated."""
        transferred = np.zeros(len(fast), dtype=np.bool_)
        rounds = self.rounds(self.replace_failures(fast), metrics)
        try:
            candidates = next(rounds)
            while True:
                transferred[candidates] = True
                candidates = rounds.send(self.replace_failures(slow[candidates]))
        except StopIteration as end:
            ranked: Ranked = end.value
            return ranked, transferred

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate, one per episode."""
        return np.array(episodes, dtype=np.float64)

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return the means, the fitness in a single simulation."""
        return np.array([row_means(np.array([row]))[0] for row in episodes])


def row_means(rows: Episodes) -> Fitness:
    """Return the mean of each row, added in order; NaN if a value is not finite."""
    if not rows.shape[0]:
        return np.empty(0)
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows has failed
        means: Fitness = np.add.accumulate(rows, axis=1)[:, -1] / rows.shape[1] + 0.0
    means[~np.isfinite(means)] = np.nan
    return means


def compress_below(values: Fitness, limit: float) -> Fitness:
    """Compress values below a finite limit, in the same order; NaN stays.

    Values above the limit or just below it are moved into a margin of 2^-30 of the limit, by the logarithm of
    their distance from its lower end. Values of several generations with the same limit are therefore also
    in order.
    """
    margin = max(abs(limit), _SMALLEST) * _MARGIN_SHARE
    end = limit - margin
    moved = values > end
    distinct, indices = np.unique(values[moved], return_inverse=True)
    with np.errstate(over="ignore"):  # infinity is far enough
        above = distinct - end
    # The bits of a positive float, read as an integer, approximate its logarithm.
    levels = end + margin * (above.view(np.int64) / 2.0**63)
    last = end
    for index, level in enumerate(levels.tolist()):
        last = max(level, math.nextafter(last, math.inf))
        levels[index] = last
    compressed = values.copy()
    compressed[moved] = np.minimum(levels, math.nextafter(limit, -math.inf))[indices]
    return compressed
