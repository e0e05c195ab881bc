"""The base class of rankings."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import compress
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema

from swarmwright.common.arrays import Fitness
from swarmwright.common.options import Options
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.problems import format_value


def _parse_failed(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str) and value in {"last", "stop"}:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # huge integer
            number = math.inf
        if math.isfinite(number):
            return number
    raise ValueError(
        f"must be last, stop or the fitness of a failed episode, a finite number, not {format_value(value)}"
    )


class RankingOptions(Options):
    """Options of every ranking."""

    kind: str = ""
    """Name of the ranking."""
    episodes: int = Field(default=1, ge=1, le=100_000)
    """Episodes per candidate; episode e has the simulation seed parameters.seed (default 0) + e, the same for
    all candidates of a generation."""
    seeds: Literal["same", "new"] = "same"
    """same: every generation uses the same seeds, as in FREVO. new: generation g begins with the seed
    parameters.seed + g * episodes, which prevents overfitting to a few episodes."""
    reevaluate: bool = False
    """Whether survivors are evaluated again in every generation, for noisy simulations and `seeds: new`.
    Their fitness covers all their episodes, and the run's best candidate is that of the last generation.
    Only for nnga, cea2d, de and pso, not with the rankings race, multi_fidelity and transferability.
    """
    failed: Annotated[
        Literal["last", "stop"] | float,
        BeforeValidator(_parse_failed),
        WithJsonSchema({"anyOf": [{"enum": ["last", "stop"]}, {"type": "number"}]}),
    ] = "last"
    """Effect of a failed episode. last: its candidate ranks below all others; the run ends if a whole
    generation fails. stop: the run ends and can be resumed. A number: its fitness, at most that of the
    worst working episode; not with map_elites, nsga2 and transferability.
    """

    @property
    def failure_fitness(self) -> float | None:
        """Fitness of a failed episode, or None."""
        return None if isinstance(self.failed, str) else self.failed


class Ranking(ABC):
    """Base class of rankings, which choose episodes and aggregate their results to fitness.

    `score` is a template around `_score` that checks shapes and separates failed candidates, so that a
    ranking receives only finite numbers.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[RankingOptions]]
    """Model of the options, including `kind`."""
    default_options: ClassVar[type[RankingOptions]] = RankingOptions
    """Options model of classes in files (`my_ranking.py:Class`) without an `options_model`."""

    def __init__(self, options: RankingOptions) -> None:
        self.options = options
        self._past: dict[bytes, list[float]] = {}

    def seeds(self, first: int, generation: int = 0) -> list[int]:
        """Return the simulation seed of each episode; `first` is the experiment's parameters.seed."""
        return self.seeds_of(first, 0 if self.options.seeds == "same" else generation)

    def seeds_of(self, first: int, number: int) -> list[int]:
        """Return disjoint sets of seeds for numbers from 0 on; see `seeds`."""
        begin = first + number * self.options.episodes
        return [begin + episode for episode in range(self.options.episodes)]

    def score(self, episodes: NDArray[np.float64], genomes: NDArray[np.float32] | None = None) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) results.

        A candidate with a failed episode (NaN or infinite), or whose aggregate overflows, gets NaN; if
        `failed` is a number, it replaces the fitness of failed episodes. With `reevaluate`, earlier episodes
        of the genomes count, too.

        Args:
            episodes: results, (candidates, episodes).
            genomes: (candidates, genome_size), only for `reevaluate`.
        """
        episodes = self.replace_failures(episodes)
        scores = np.full(len(episodes), np.nan)
        if self.options.reevaluate and genomes is not None:
            rows = self._with_past(episodes.tolist(), genomes)
            worked = np.array([all(map(math.isfinite, row)) for row in rows], dtype=bool)
        else:
            rows = None
            worked = np.asarray(np.isfinite(episodes).all(axis=1))
        if worked.any():
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows has failed
                if rows is not None:
                    fitness = self._score(list(compress(rows, worked)))
                else:
                    fitness = self._score_array(episodes if worked.all() else episodes[worked])
            if is_plug_in(type(self)):
                fitness = self._check_scores(fitness, int(np.count_nonzero(worked)))
            # Adding 0.0 turns -0.0 into 0.0: equal fitness has one representation.
            scores[worked] = fitness + 0.0
        scores[~np.isfinite(scores)] = np.nan
        return scores

    def replace_failures(self, episodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Replace the fitness of failed episodes by `failed`, if that is a number.

        Args:
            episodes: results of any shape, NaN or infinite where an episode failed.
        """
        value = self.options.failure_fitness
        return episodes if value is None else np.where(np.isfinite(episodes), episodes, value)

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return independent fitness values of one candidate, from more episodes than a ranking uses.

        Their mean estimates the candidate's fitness on other seeds. By default, the scores of consecutive
        groups of `options.episodes`, without a remainder.

        Args:
            episodes: results, finite, of one candidate.
        """
        size = self.options.episodes
        count = len(episodes) // size
        return self.score(np.array(episodes[: count * size], dtype=np.float64).reshape(count, size))

    def _with_past(self, rows: list[list[float]], genomes: NDArray[np.float32]) -> list[list[float]]:
        """Return all episodes of each genome, including those of earlier generations."""
        keys = [genome.tobytes() for genome in genomes]
        whole = [[*self._past.get(key, ()), *row] for key, row in zip(keys, rows, strict=True)]
        self._past = dict(zip(keys, whole, strict=True))
        return whole

    def _score_array(self, episodes: NDArray[np.float64]) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) finite results of at least one candidate.

        Calls `_score` by default; override it to work on arrays, which is faster for large populations.
        """
        return np.asarray(self._check_scores(self._score(episodes.tolist()), len(episodes)), dtype=np.float64)

    def _check_scores(self, scores: Fitness, candidates: int) -> Fitness:
        """Check the scores of a plug-in. Raises PlugInError for other values."""
        by_array = type(self)._score_array is not Ranking._score_array
        method = "_score_array" if by_array else "_score"
        return numbers(
            self, method, scores, (candidates,), "fitness, (candidates,)", finite=False, dtype=np.float64
        )

    @abstractmethod
    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return (candidates,) fitness from the finite results of each candidate; lengths vary."""
