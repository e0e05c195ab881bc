"""What every ranking does."""

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


def _failed(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str) and value in {"last", "stop"}:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # of a huge integer
            number = math.inf
        if math.isfinite(number):
            return number
    raise ValueError(
        f"must be last, stop or the fitness of a failed episode, a finite number, not {format_value(value)}"
    )


class RankingOptions(Options):
    """Options of every ranking."""

    kind: str = ""
    """The name of the ranking; each has its own."""
    episodes: int = Field(default=1, ge=1, le=100_000)
    """Episodes per candidate; episode e has the simulation seed parameters.seed (default 0) + e. All
    candidates of a generation have the same seeds (common random numbers)."""
    seeds: Literal["same", "new"] = "same"
    """same: the episodes of every generation have the same seeds (FREVO's way). new: generation g begins with
    the seed parameters.seed + g * episodes, so that evolution cannot fit itself to a few episodes."""
    reevaluate: bool = False
    """Whether members that stay are evaluated again in every generation. Their fitness is then made of all
    their episodes since they came, so that one lucky evaluation does not dominate permanently, and the best
    candidate of the run is that of the last generation. For noisy simulations and `seeds: new`; costs the
    evaluations of the members that stay. Only for the methods nnga, cea2d, de and pso, and not with the
    rankings race, multi_fidelity and transferability."""
    failed: Annotated[
        Literal["last", "stop"] | float,
        BeforeValidator(_failed),
        WithJsonSchema({"anyOf": [{"enum": ["last", "stop"]}, {"type": "number"}]}),
    ] = "last"
    """What a failed episode leads to. last: its candidate fails and ranks below all others, and the run goes
    on; a generation of which all candidates failed ends it. stop: the run ends, its results are kept, and
    `swarmwright resume` continues when the cause is fixed. A number: the fitness of a failed episode, which
    is aggregated with that of the others, in the run and on held-out seeds, so that no mean leaves failures
    out; take a value that is at most as good as the worst episode that works. Failed evaluations are counted
    in any case. Not with the methods map_elites and nsga2 and the ranking transferability: they compare
    metrics, which a failed episode does not have."""

    @property
    def failure_fitness(self) -> float | None:
        """Fitness of a failed episode; None where it has none."""
        return None if isinstance(self.failed, str) else self.failed


class Ranking(ABC):
    """Says which episodes a candidate goes through and turns what came out into one fitness per candidate.

    `score` is a template around `_score`: it checks the shapes and keeps failed candidates apart, so that a
    ranking only ever sees numbers.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[RankingOptions]]
    """Typed options, with `kind` among them."""
    default_options: ClassVar[type[RankingOptions]] = RankingOptions
    """Those of a class in a file (`my_ranking.py:Class`) that has no `options_model`."""

    def __init__(self, options: RankingOptions) -> None:
        self.options = options
        self._past: dict[bytes, list[float]] = {}

    def seeds(self, first: int, generation: int = 0) -> list[int]:
        """Return the simulation seed of each episode; `first` is the experiment's parameters.seed."""
        return self.seeds_of(first, 0 if self.options.seeds == "same" else generation)

    def seeds_of(self, first: int, number: int) -> list[int]:
        """Return the seeds of each number from 0 on, which have none in common; see `seeds`."""
        begin = first + number * self.options.episodes
        return [begin + episode for episode in range(self.options.episodes)]

    def score(self, episodes: NDArray[np.float64], genomes: NDArray[np.float32] | None = None) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) results.

        A candidate of which any episode failed (NaN or infinite), or whose aggregate overflows, has failed:
        NaN; where `failed` is a number, that is the fitness of a failed episode. With `reevaluate`, what is
        known of the genomes from the last call counts, too.

        Args:
            episodes: results, (candidates, episodes).
            genomes: (candidates, genome_size); needed with `reevaluate` only.
        """
        episodes = self.counted(episodes)
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
                    made = self._score(list(compress(rows, worked)))
                else:
                    made = self._score_array(episodes if worked.all() else episodes[worked])
            if is_plug_in(type(self)):
                made = self._made(made, int(np.count_nonzero(worked)))
            # Adding 0.0 turns -0.0 into 0.0: equal fitness has one representation.
            scores[worked] = made + 0.0
        scores[~np.isfinite(scores)] = np.nan
        return scores

    def counted(self, episodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return results in which failed episodes have the fitness `failed`, where that is a number.

        Args:
            episodes: results of any shape, NaN or infinite where an episode failed.
        """
        value = self.options.failure_fitness
        return episodes if value is None else np.where(np.isfinite(episodes), episodes, value)

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return independent fitness values of one candidate, from more episodes than a ranking takes.

        Their mean estimates what the candidate's fitness is on other seeds. By default the score of each
        `options.episodes` in a row, a rest left out.

        Args:
            episodes: results, finite, of one candidate.
        """
        size = self.options.episodes
        count = len(episodes) // size
        return self.score(np.array(episodes[: count * size], dtype=np.float64).reshape(count, size))

    def _with_past(self, rows: list[list[float]], genomes: NDArray[np.float32]) -> list[list[float]]:
        """Return all episodes of each genome: of one that was there before, the past, too."""
        keys = [genome.tobytes() for genome in genomes]
        whole = [[*self._past.get(key, ()), *row] for key, row in zip(keys, rows, strict=True)]
        self._past = dict(zip(keys, whole, strict=True))
        return whole

    def _score_array(self, episodes: NDArray[np.float64]) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) finite results, one candidate at least.

        By default that of `_score`; a ranking that works on arrays is faster with large populations.
        """
        return np.asarray(self._made(self._score(episodes.tolist()), len(episodes)), dtype=np.float64)

    def _made(self, scores: Fitness, candidates: int) -> Fitness:
        """Return what the ranking made of results. Raises PlugInError when it is something else."""
        by_array = type(self)._score_array is not Ranking._score_array
        method = "_score_array" if by_array else "_score"
        return numbers(
            self, method, scores, (candidates,), "fitness, (candidates,)", finite=False, dtype=np.float64
        )

    @abstractmethod
    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return (candidates,) fitness of each one's results: finite, at least one, not all equally many."""
