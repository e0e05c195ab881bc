"""Validation of competitions: champions against opponents that evolution has not met, on held-out seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.league import (
    LeftOut,
    Participant,
    describe_left_out,
    format_seeds,
    load_participants,
    play_matches,
    select_participants,
)
from swarmwright.analysis.table import columns, number
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.formatting import format_count
from swarmwright.common.random_numbers import Stream
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.kinds.team import Team
from swarmwright.experiment.competition import needed_metrics, opponents_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.opponents import Opponent, find_run, load_opponent
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs.matches import sides_of
from swarmwright.runs.post_evaluation import EvaluationOptions
from swarmwright.runs.run import Run
from swarmwright.runs.validation import format_validation_command
from swarmwright.servers.evaluation.opening import open_backend

Values = NDArray[np.float64]

_RESAMPLES = 2000
"""Bootstrap samples of an interval."""
_TAIL = 2.5
"""Percentage of the bootstrap samples on each side of the 95 % interval."""


@dataclass(frozen=True)
class SideResult:
    """A controller's matches on a side."""

    mean: float
    """Mean of its own fitness; NaN if all matches have failed."""
    low: float | None
    """Lower end of the 95 % interval, from resampled opponents and seeds; None for a single result."""
    high: float | None
    wins: int
    """Episodes in which its fitness was above that of the other side."""
    draws: int
    losses: int
    failed: int
    """Episodes that failed, which do not count."""

    @classmethod
    def of(cls, own: Values, other: Values) -> "SideResult":
        """Summarize the fitness of both sides, (opponents, seeds); NaN where a match failed."""
        finished = np.isfinite(own)
        mean = float(own[finished].mean()) if finished.any() else float("nan")
        with np.errstate(invalid="ignore"):
            wins, draws, losses = (
                int(np.count_nonzero(each)) for each in (own > other, own == other, own < other)
            )
        low, high = _resample(own)
        return cls(mean, low, high, wins, draws, losses, int(np.count_nonzero(~finished)))

    @property
    def cells(self) -> list[str]:
        """The cells of a table: fitness, interval, won, drawn, lost."""
        interval = "-" if self.low is None else f"{self.low:.5g} to {self.high:.5g}"
        return [number(self.mean), interval, *map(str, (self.wins, self.draws, self.losses))]


def _resample(values: Values) -> tuple[float, float] | tuple[None, None]:
    """Return the 95 % interval of a mean over opponents and seeds, (opponents, seeds).

    Both are resampled independently, as all opponents meet in the same episodes: the pigeonhole bootstrap of
    Owen, The Annals of Applied Statistics 1(2), 2007.
    """
    finished = np.isfinite(values)
    if np.count_nonzero(finished) < 2:
        return None, None
    random = Stream(0, "competition.validation", 0, 0)
    rows, seeds = (
        np.stack([
            np.bincount(drawn, minlength=count)
            for drawn in np.asarray(random.integers(count, _RESAMPLES * count)).reshape(_RESAMPLES, count)
        ]).astype(np.float64)
        for count in values.shape
    )  # fmt: skip
    totals, counts = (
        ((rows @ cells) * seeds).sum(axis=1) for cells in (np.where(finished, values, 0.0), finished * 1.0)
    )
    means = totals[counts > 0] / counts[counts > 0]
    low, high = np.percentile(means, [_TAIL, 100 - _TAIL])
    return float(low), float(high)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CompetitionValidation:
    """Champions of a run against opponents that its evolution has not met; `print` shows the tables."""

    name: str
    """Name of the run's folder."""
    generations: tuple[int, ...]
    """Generations of the champions, ascending."""
    opponents: tuple[Participant, ...]
    seeds: list[int]
    """Seed of each episode of each match."""
    fitness: Mapping[str, Values]
    """Side -> (champions, opponents, seeds, 2): the champion's fitness on this side, and that of its
    opponent; NaN where a match failed or the opponent cannot play the other side."""
    can_play: Mapping[str, NDArray[np.bool_]]
    """Side -> (opponents,): whether the opponent can play the other side."""
    left_out: tuple[LeftOut, ...] = ()

    @cached_property
    def champions(self) -> dict[str, list[SideResult]]:
        """Side -> the result of the champion of each generation against all opponents."""
        return {
            side: [SideResult.of(*np.moveaxis(each[self.can_play[side]], -1, 0)) for each in values]
            for side, values in self.fitness.items()
        }

    @cached_property
    def by_opponent(self) -> dict[str, list[tuple[str, SideResult]]]:
        """Side -> the result of the last champion against each opponent, with its name."""
        return {
            side: [
                (opponent.name, SideResult.of(*np.moveaxis(values[-1, [index]], -1, 0)))
                for index, opponent in enumerate(self.opponents)
                if self.can_play[side][index]
            ]
            for side, values in self.fitness.items()
        }

    def __repr__(self) -> str:
        return f"<CompetitionValidation of {self.name}: {len(self.opponents)} opponents>"

    def __str__(self) -> str:
        count, episodes = (
            format_count(len(self.opponents), "opponent"),
            format_count(len(self.seeds), "episode"),
        )
        title = f"Champions of {escape_line(self.name)} against {count} that it has not met"
        lines = [f"{title}, {episodes} each, seeds {format_seeds(self.seeds)}"]
        head = ["fitness", "95 %", "won", "drawn", "lost"]
        for side, results in self.champions.items():
            own = zip(self.generations, results, strict=True)
            rows = [["generation", *head], *([str(generation), *result.cells] for generation, result in own)]
            by_name = [[name, *result.cells] for name, result in self.by_opponent[side]]
            lines += ["", f"Side {escape_line(side)}", "", *columns(rows)]
            if len(by_name) > 1:
                last = self.generations[-1]
                lines += ["", *columns([[f"generation {last} against", *head], *by_name])]
        failed = sum(result.failed for results in self.champions.values() for result in results)
        ends = [f"{format_count(failed, 'episode')} failed and did not count."] if failed else []
        ends += describe_left_out(self.left_out)
        return "\n".join([*lines, *([""] if ends else []), *ends])

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON; NaN is not converted."""
        return {
            "run": self.name,
            "generations": list(self.generations),
            "opponents": [
                {"name": opponent.name, "sha256": opponent.opponent.digest} for opponent in self.opponents
            ],
            "seeds": self.seeds,
            "sides": {
                side: {
                    "champions": [vars(result) for result in results],
                    "by_opponent": [
                        {"name": name, **vars(result)} for name, result in self.by_opponent[side]
                    ],
                    "fitness": self.fitness[side].tolist(),
                }
                for side, results in self.champions.items()
            },
            "left_out": [each._asdict() for each in self.left_out],
        }


def validate_competition(
    run: Run, experiment: Experiment, against: Sequence[str], where: EvaluationOptions, *, champions: int = 1
) -> CompetitionValidation:
    """Let champions of a run play against controllers that its evolution has not met.

    Args:
        run: a competition of two sides.
        experiment: the run's, or a changed copy.
        against: other runs (their best), RUN:GENERATION:CANDIDATE, bundles, and files of controllers.
        where: episodes of each match, and where they are evaluated. By default, seeds that no run has used.
        champions: number of champions, of evenly spaced generations; one is the last.

    Raises:
        InputError: the run is not a competition of two sides, or no opponent is new to it and fits.
        RunError: no broker, no matching server, or all episodes failed.
    """
    options = experiment.ranking
    if not isinstance(options, TournamentOptions):
        command = format_validation_command(run)
        raise InputError(f"{run.path}: is not a competition; validate it on held-out seeds: {command}")
    sides = sides_of(experiment)
    if len(sides) != 2:
        raise InputError(
            f"{run.path}: validation needs two sides, a champion and its opponent, but the run has "
            f"{', '.join(sides)}"
        )
    lineups = run.champions(sides[0])
    if not lineups:
        raise InputError(f"{run.path}: has no finished generation, so there is no champion")
    picked = np.linspace(len(lineups) - 1, 0, min(champions, len(lineups))).round().astype(np.intp)
    rows = [run._store.evaluation(lineups[index].evaluation, None) for index in np.unique(picked).tolist()]
    own = [load_opponent(f"{run.path}:{row.generation}:{row.candidate}") for row in rows]
    inside = [source for source in against if _is_from(run, source)]
    loaded, left_out, used_seeds = load_participants(Path(), [each for each in against if each not in inside])
    left_out += [_leave_out(escape_line(source)) for source in inside]
    seeds = where.seeds(experiment, run._store.collect_seeds() | used_seeds)
    with open_backend(
        experiment, broker=where.broker, servers=where.servers, metrics=needed_metrics(options)
    ) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        assert isinstance(representation, Team)
        architecture = representation.architecture()
        players, _ = select_participants(own, architecture, experiment)
        known_genomes = _collect_met(run, options, representation)
        fitting, unfit = select_participants(loaded, architecture, experiment)
        opponents = []
        for participant in fitting:
            if any(_genes(part) in known_genomes for part in participant.sides.values()):
                left_out.append(_leave_out(participant.name))
            else:
                opponents.append(participant)
        left_out = sorted([*left_out, *unfit])
        evolved = [side for side, name in enumerate(sides) if name in (experiment.populations or sides)]
        count = len(players)
        playable = np.zeros((count + len(opponents),) * 2, dtype=bool)
        for side in evolved:
            can_play = np.array([1 - side in opponent.sides for opponent in opponents], dtype=bool)
            block = (slice(count), slice(count, None))
            playable[block if side == 0 else block[::-1]] = can_play if side == 0 else can_play[:, np.newaxis]
        if not playable.any():
            reasons = "".join(f"; {each.reason}" for each in left_out[:3])
            raise InputError(f"no opponent can play against the champions of {run.path}{reasons}")
        fitness = play_matches(
            [*players, *opponents], playable, architecture, experiment, seeds, where, backend
        )
    if not np.isfinite(fitness).any():
        raise RunError("every episode failed; the reasons are above")
    return CompetitionValidation(
        name=run.path.resolve().name,
        generations=tuple(row.generation for row in rows),
        opponents=tuple(opponents),
        seeds=seeds,
        fitness={
            sides[side]: fitness[:count, count:]
            if side == 0
            else np.swapaxes(fitness[count:, :count], 0, 1)[..., ::-1]
            for side in evolved
        },
        can_play={
            sides[side]: np.array([1 - side in opponent.sides for opponent in opponents], dtype=bool)
            for side in evolved
        },
        left_out=tuple(left_out),
    )


def _is_from(run: Run, source: str) -> bool:
    """Return whether an opponent is a candidate of the run itself."""
    origin = find_run(source, Path())
    return origin is not None and origin.resolve() == run.path.resolve()


def _leave_out(name: str) -> LeftOut:
    return LeftOut(name, f"{name}: is from this evolution, or was met in it, so it proves nothing")


def _collect_met(run: Run, options: TournamentOptions, representation: Team) -> set[bytes]:
    """Return the genes of all champions of a run, and of its external opponents."""
    opponents = opponents_of(options, representation, ())
    return {
        genes.tobytes()
        for side in representation.parts
        for genes in (*opponents[side].values(), *(champion.genome for champion in run.champions(side)))
    }


def _genes(opponent: Opponent) -> bytes:
    return (opponent.weights if opponent.genome is None else opponent.genome).tobytes()
