"""What rankings share that evaluate some candidates in a second simulation, slow and closer to reality."""

from abc import abstractmethod
from collections.abc import Generator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from swarmwright.core.problems import shown
from swarmwright.rankings._base import Ranking, RankingOptions
from swarmwright.typing import Fitness

METRIC = "slow_fitness"
"""The metric of the record that has the fitness in the slow simulation, NaN where a candidate has none."""
Episodes = NDArray[np.float64]


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
    raise ValueError(f"must be a simulation, a file, or keys that differ, not {shown(value)}")


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
            raise ValueError(
                "reevaluate: the fitness of members that stay is of two simulations; leave it out, or take "
                "kind: absolute"
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
        rounds = self.rounds(fast, metrics)
        try:
            who = next(rounds)
            while True:
                who = rounds.send(slow[who])
        except StopIteration as end:
            found: Ranked = end.value
            self.learn(found.learned)
            return found.fitness

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
