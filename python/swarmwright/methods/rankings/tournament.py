"""Tournaments: candidates meet in matches, and their results against each other are their fitness.

A match is an episode with several sides, each controlled by a candidate of its own. See
`swarmwright.methods.competition` for who meets whom.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from swarmwright import _engine
from swarmwright.common.arrays import Fitness
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.yaml import Path_
from swarmwright.methods.rankings._base import Ranking, RankingOptions

MOST_SIDES = 16
"""Upper limit of sides of a match."""
MOST_OPPONENTS = 256
"""Upper limit of opponents of a side."""
ONLY_OPPONENTS = "opponents"
"""Pairing without matches of candidates against each other."""
Pairing = Literal[
    "round_robin",
    "swiss",
    "multi_swiss",
    "merge_sort",
    "random",
    "hall_of_fame",
    "best",
    "pareto_archive",
    "opponents",
    "frevo_full_tournament",
    "frevo_swiss_system",
    "frevo_multi_swiss",
]
BETWEEN_POPULATIONS = frozenset(
    {"round_robin", "random", "hall_of_fame", "best", "pareto_archive", ONLY_OPPONENTS}
)
"""Pairings that several populations can use."""
AGAINST_CHAMPIONS = frozenset({"hall_of_fame", "best", "pareto_archive"})
"""Pairings with champions of earlier generations."""
_RATED = frozenset({"swiss", "multi_swiss"})
"""Pairings in which the best meet the best, so that points depend on the opponents."""
Score = Literal["points", "win_rate", "fitness", "elo", "bradley_terry", "order", "frevo_multi_swiss"]


def _parse_sides(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value is None or value == {}:
        return None
    if isinstance(value, list | tuple):
        for name in value:
            if not isinstance(name, str) or not name:
                raise ValueError(f"must be a list of names such as [left, right], not {format_value(value)}")
            if list(value).count(name) > 1:
                raise ValueError(f"names {name!r} twice")
        value = dict.fromkeys(value)
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a list of names such as [left, right], not {format_value(value)}")
    if not 2 <= len(value) <= MOST_SIDES:
        raise ValueError(f"a match has 2 to {MOST_SIDES} sides, not {len(value)}")
    for name, fitness in value.items():
        if not isinstance(name, str) or not name:
            raise ValueError(f"the name of a side must be text, not {format_value(name)}")
        if fitness is not None and (not isinstance(fitness, str) or not fitness):
            raise ValueError(f"{name}: must be a fitness expression, not {format_value(fitness)}")
    return dict(value)


def _parse_opponents(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value in (None, [], {}):
        return None
    if isinstance(value, Mapping):
        return {str(side): _parse_entries(entries, (str(side),)) for side, entries in value.items()}
    return _parse_entries(value, ())


def _parse_entries(value: Any, path: Path_) -> list[Any]:  # noqa: ANN401 - whatever the file says
    if not isinstance(value, list | tuple) or not value:
        raise FieldError(
            path,
            "must be a list of runs, bundles and controllers, such as [run-a, their.bundle], or one for "
            f"each side, {{left: [run-a]}}, not {format_value(value)}",
        )
    if len(value) > MOST_OPPONENTS:
        raise FieldError(path, f"has {len(value)} opponents; at most {MOST_OPPONENTS} are possible")
    return list(value)


_ENTRIES = {"type": "array", "items": {"type": ["string", "object"]}}


class TournamentOptions(RankingOptions):
    """Candidates meet in matches; their results against each other are their fitness."""

    kind: Literal["tournament"] = "tournament"
    sides: Annotated[
        Any,
        BeforeValidator(_parse_sides),
        WithJsonSchema(
            {
                "anyOf": [
                    {"type": "array", "items": {"type": "string"}},
                    {"type": "object", "additionalProperties": {"type": ["string", "null"]}},
                    {"type": "null"},
                ]
            }
        ),
    ] = None
    """Sides of a match: groups of agents of the simulation, [left, right], or with the fitness of each, an
    expression over metrics: {left: left_goals - right_goals, right: right_goals - left_goals}. Default: the
    populations, or all sides of the simulation, with the fitness that it announces. Of two sides without
    any, the first has the simulation's fitness and the second its negative.
    """
    pairing: Pairing = "random"
    """How opponents are chosen. round_robin: all others. random: `rounds` random opponents. swiss: `rounds`
    opponents with similar results so far; multi_swiss: several such tournaments. merge_sort: matches are the
    comparisons of a merge sort. hall_of_fame: the last champion and random earlier ones, `rounds` in total.
    best: the last champion. pareto_archive: the last champion, and earlier ones against which the
    non-dominated champions have different results, at most `rounds` in total. opponents: only those of the
    option `opponents`. With populations: round_robin, random, hall_of_fame, best, pareto_archive, opponents.
    frevo_full_tournament, frevo_swiss_system, frevo_multi_swiss: FREVO's rankings, for imported sessions; its
    MultiSort is random.
    """
    opponents: Annotated[
        Any,
        BeforeValidator(_parse_opponents),
        WithJsonSchema(
            {"anyOf": [_ENTRIES, {"type": "object", "additionalProperties": _ENTRIES}, {"type": "null"}]}
        ),
    ] = None
    """External controllers that every candidate meets in each generation, in addition to `pairing`: run
    folders (their best), RUN:GENERATION:CANDIDATE, bundles and controller files, relative to this file. Each
    plays every side that it fits; or list them for each side, {left: [run-a], right: [their.bundle]}. A side
    without a population is played by its opponents alone. The run keeps copies.
    """
    rounds: int | None = Field(default=None, ge=1, le=10_000)
    """Opponents of a candidate. Default: 10 with random, hall_of_fame and pareto_archive; with swiss and
    multi_swiss as many as a knock-out tournament would have rounds; with round_robin all."""
    tournaments: int = Field(default=3, ge=1, le=1000)
    """Tournaments of multi_swiss."""
    both_sides: bool = True
    """Whether two candidates of one population meet twice, with exchanged sides. Without it, each plays each
    side about equally often."""
    score: Score | None = None
    """A candidate's fitness from its matches. points: the sum of `win` for a victory and `draw` for a draw.
    win_rate: the mean of 1 and 0.5 for them. fitness: mean of its own fitness. elo, bradley_terry: a rating
    that takes the opponents' strength into account. order: the number of candidates that it beats, directly
    or through others; the result of merge_sort. frevo_multi_swiss: the mean of 2 for a victory and 1 for
    a defeat. With populations: points, fitness. Default: bradley_terry with swiss and multi_swiss, else
    fitness."""
    win: float = Field(default=1.0, gt=0, le=1e6)
    """Points for a victory, also where swiss pairs by points; a defeat has none."""
    draw: float = Field(default=0.5, ge=0, le=1e6)
    """Points of both for a draw."""

    @property
    def score_or_default(self) -> Score:
        """The score, or without one the default of the pairing."""
        return self.score or ("bradley_terry" if self.pairing in _RATED else "fitness")

    @model_validator(mode="after")
    def _check_reevaluate(self) -> "TournamentOptions":
        if self.reevaluate:
            raise FieldError(
                ("reevaluate",), "survivors always compete again in a tournament; leave the key out"
            )
        return self


class Tournament(Ranking):
    """The mean fitness of a match's first side over its episodes; see `competition` for candidates.

    Sources: tournaments as rankings are those of FREVO (Sobe, Fehervari and Elmenreich, "FREVO: a tool for
    evolving and evaluating self-organizing systems", 2012); the hall of fame is that of Rosin and Belew, "New
    methods for competitive coevolution", Evolutionary Computation 5(1), 1997.
    """

    kind: ClassVar[str] = "tournament"
    options_model = TournamentOptions
    options: TournamentOptions

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return one fitness value per episode."""
        return np.array(episodes, dtype=np.float64)

    def _score_array(self, episodes: NDArray[np.float64]) -> Fitness:
        return _engine.aggregates(np.ascontiguousarray(episodes), "mean", 0.25)

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        rows = (np.array([row], dtype=np.float64) for row in episodes)
        return np.concatenate([self._score_array(row) for row in rows])
