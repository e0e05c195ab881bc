"""Progress of competitions: do later champions beat earlier ones, or do they go in circles?

Fitness says nothing about it, since the opponents change with it. Therefore champions of all generations of
each side meet those of the other side, or of all other sides together: the master tournament of Nolfi and
Floreano, "Coevolving predator and prey robots: do 'arms races' arise in artificial evolution?", Artificial
Life 4(4), 1998. The matches against earlier opponents alone are those of Cliff and Miller, "Tracking the red
queen: measurements of adaptive progress in co-evolutionary simulations", ECAL 1995.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.standings import games_against_equals, standings
from swarmwright.analysis.table import write_csv
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError
from swarmwright.display.figures.progress import choose_side_colors, draw_progress
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.robots import find_colors
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.matches import FIRST_SEED, play_all, sides_of, stack_champions
from swarmwright.runs.run import Run
from swarmwright.servers.evaluation.base import Progress, Servers

Values = NDArray[np.float64]

_RESAMPLES = 400
"""Samples of each bootstrap and of the null model."""
_LEVEL = 0.95
_LARGEST_FITNESS = 1e100
"""Its squares can be added up."""
_COLUMNS = ("means", "low", "high", "ratings", "ratings_low", "ratings_high")
_MOST = {"champions": 1000, "episodes": 10_000, "seed": 2**62}
"""Upper limits of arguments."""


@dataclass(frozen=True)
class SideProgress:
    """Champions of a side against those of the other side, or of all other sides together."""

    side: str
    opponents: str
    """The other side; of several, "the others"."""
    generations: tuple[int, ...]
    """Generations of the champions, ascending."""
    outcomes: Values
    """(generations, generations of the opponents): mean fitness of this side over the episodes."""
    means: Values
    """(generations,): mean of the outcomes of each champion."""
    low: Values
    """(generations,): lower limits of their 95 % intervals, from resampled seeds."""
    high: Values
    """(generations,): upper limits."""
    ratings: Values
    """(generations,): Bradley-Terry ratings in the units of Elo's, 0 for the average champion of this side.
    A champion wins against another if its fitness is higher against the same opponent and seed."""
    ratings_low: Values
    """(generations,): lower limits of their 95 % intervals, from resampled seeds."""
    ratings_high: Values
    """(generations,): upper limits."""
    gain: float
    """Mean of the last tenth of the champions minus that of the first, at least one champion each."""
    gain_low: float
    gain_high: float
    """95 % interval of the gain."""
    ancestors: float
    """Mean outcome against opponents of earlier generations, NaN without any."""
    take: int
    """The earliest generation that is not clearly worse than the best one."""
    cyclic_share: float
    """See `cyclic_share`."""
    null: tuple[float, float]
    """The same in games without cycles that have the same noise: 2.5 % and 97.5 % quantiles."""

    @property
    def cycles(self) -> bool:
        """Whether the cyclic share is more than noise explains."""
        return self.cyclic_share > self.null[1] + 1e-9

    @property
    def verdict(self) -> str:
        """The gain in words."""
        if self.gain_low > 0:
            return "later champions are better"
        return "later champions are worse" if self.gain_high < 0 else "no clear progress"

    def columns(self) -> dict[str, list[float]]:
        """Return means, ratings and their intervals of the champions, by name."""
        return {name: getattr(self, name).tolist() for name in _COLUMNS}

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "generations": list(self.generations),
            **self.columns(),
            "gain": self.gain,
            "gain_low": self.gain_low,
            "gain_high": self.gain_high,
            "ancestors": None if np.isnan(self.ancestors) else self.ancestors,
            "take": self.take,
            "cyclic_share": self.cyclic_share,
            "null": list(self.null),
            "cycles": self.cycles,
        }


@dataclass(frozen=True)
class CompetitionProgress:
    """Progress of all sides of a run."""

    run: Run
    sides: tuple[SideProgress, ...]
    episodes: int
    """Episodes of each match."""
    seed: int
    """Seed of the first."""

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "run": str(self.run.path),
            "sides": {side.side: side.summary() for side in self.sides},
            "cycles": any(side.cycles for side in self.sides),
            "champions": len(self.sides[0].generations),
            "episodes": self.episodes,
            "seed": self.seed,
        }

    def plot(self, path: str | PathLike[str]) -> None:
        """Draw outcomes, means and ratings: .png, .svg or .pdf.

        Raises InputError for another suffix, and if the file cannot be written.
        """
        from swarmwright.display.figures import style

        heading = f"Progress of {self.run.name}"
        style.save(draw_progress(self.sides, heading, color_sides(self.run.experiment)), Path(path))

    def export(self, path: str | PathLike[str]) -> None:
        """Write a table, .csv, with a row for each champion of each side.

        Raises InputError for another suffix, and if the file cannot be written.
        """
        rows = (
            [side.side, *row]
            for side in self.sides
            for row in zip(side.generations, *side.columns().values(), strict=True)
        )
        write_csv(path, ["side", "generation", *_COLUMNS], rows)


@check_arguments
def measure_progress(
    run: Run,
    *,
    experiment: Experiment | None = None,
    champions: int = 30,
    episodes: int = 10,
    seed: int = FIRST_SEED,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> CompetitionProgress:
    """Let champions of all generations meet, and measure the progress of each side.

    Of more than two sides, each meets the champions that the others had in a generation.

    Args:
        run: a competition.
        experiment: in place of the run's, with other settings.
        champions: number of champions of each side, of evenly spaced generations, at least 2.
        episodes: episodes of each match, at least 2, from which the noise is estimated.
        seed: seed of the first episode.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the run is not a competition, or has fewer than two generations.
        RunError: matches failed, their fitness is beyond ±1e100, or there is no server.
    """
    for name, value, least in (("champions", champions, 2), ("episodes", episodes, 2), ("seed", seed, 0)):
        if not least <= value <= _MOST[name]:
            raise InputError(f"{name}: must be from {least} to {_MOST[name]}, not {value}")
    sides = sides_of(run.experiment)
    if run.generations < 2:
        raise InputError(
            f"{run.path}: progress needs at least two finished generations, not {run.generations}"
        )
    generations = spread(run.generations, champions)
    joined = stack_champions(run, generations)
    experiment = experiment or resolve_experiment(run, generations[-1])
    # Of two sides, the matches of one are those of the other.
    playing = sides if len(sides) > 2 else sides[:1]
    results = []
    for number, side in enumerate(playing):

        def follow(done: int, total: int, waiting_for: str, number: int = number) -> None:
            if on_progress is not None:
                on_progress(number * total + done, len(playing) * total, waiting_for)

        fitness = play_all(
            experiment,
            joined,
            side,
            range(seed, seed + episodes),
            broker=broker,
            servers=servers,
            on_progress=follow,
        )
        _check_fitness(fitness)
        results.append(fitness[..., number])
        if len(playing) < len(sides):
            results.append(fitness[..., 1].transpose(1, 0, 2))
    measured = []
    for side, values in zip(sides, results, strict=True):
        others = [name for name in sides if name != side]
        measured.append(assess(side, generations, values, others[0] if len(others) == 1 else "the others"))
    return CompetitionProgress(run, tuple(measured), episodes, seed)


def _check_fitness(fitness: Values) -> None:
    """Raise RunError unless all matches have a fitness that can be averaged, (.., episodes, sides)."""
    failed = int(np.count_nonzero(~np.isfinite(fitness).all(axis=(2, 3))))
    if failed:
        matches = fitness.shape[0] * fitness.shape[1]
        raise RunError(f"{failed} of {matches} matches failed; progress needs all of them")
    largest = float(np.abs(fitness).max())
    if largest > _LARGEST_FITNESS:
        raise RunError(
            f"fitness is up to {largest:.3g}, but progress needs at most {_LARGEST_FITNESS:g}; scale it down"
        )


def color_sides(experiment: Experiment) -> list[str]:
    """Return the colour of each side of a competition, such as `#0072B2`: that of its robots in pictures."""
    colors = find_colors(experiment.simulation, experiment.parameters)
    return choose_side_colors([colors.get(side) for side in sides_of(experiment)])


def spread(generations: int, most: int) -> list[int]:
    """Return evenly spaced generations, at most this many, of which the first and the last are some."""
    numbers = np.linspace(0, generations - 1, min(most, generations))
    return [int(number) for number in np.unique(numbers.round())]


def assess(
    side: str, generations: Sequence[int], values: Values, opponents: str = "the others"
) -> SideProgress:
    """Return the progress of a side.

    Args:
        side: its name.
        generations: generations of its champions and of its opponents.
        values: (generations, generations, episodes) fitness of this side, finite.
        opponents: what the opponents are called.
    """
    random = np.random.default_rng(len(generations))
    outcomes = values.mean(axis=2)
    means = outcomes.mean(axis=1)
    by_seed = values.mean(axis=1)  # all matches have the same seeds, so seeds are resampled, not cells
    samples = np.stack([
        by_seed[:, random.integers(values.shape[2], size=values.shape[2])].mean(axis=1)
        for _ in range(_RESAMPLES)
    ])  # fmt: skip
    low, high = _interval(samples)
    tenth = max(1, len(generations) // 10)
    gains = samples[:, -tenth:].mean(axis=1) - samples[:, :tenth].mean(axis=1)
    gain_low, gain_high = _interval(gains)
    best = int(np.argmax(means))
    lead_low, lead_high = _interval(samples[:, best, np.newaxis] - samples)
    take = int(np.flatnonzero((lead_low <= 0) & (lead_high >= 0))[0])
    earlier = np.tril_indices(len(generations), -1)
    share = cyclic_share(outcomes)
    table = standings(games_against_equals(values))
    ratings = np.array([row.rating for row in table])
    intervals = [row.rating_interval or (row.rating, row.rating) for row in table]
    return SideProgress(
        side=side,
        opponents=opponents,
        generations=tuple(generations),
        outcomes=outcomes,
        means=means,
        low=low,
        high=high,
        ratings=ratings,
        ratings_low=np.array([interval[0] for interval in intervals]),
        ratings_high=np.array([interval[1] for interval in intervals]),
        gain=float(means[-tenth:].mean() - means[:tenth].mean()),
        gain_low=float(gain_low),
        gain_high=float(gain_high),
        ancestors=float(outcomes[earlier].mean()) if len(generations) > 1 else float("nan"),
        take=generations[take],
        cyclic_share=share,
        null=_find_null_range(values, random),
    )


def cyclic_share(outcomes: Values) -> float:
    """Return the share of the outcomes' variation that no ranking of the players explains, 0 to 1.

    Without cycles, players can be ranked so that a better one does better against every opponent. The share
    is what remains of the outcomes after the best fit of that form (isotonic regression for each opponent).
    It is the cyclic part of Balduzzi, Tuyls, Perolat and Graepel, "Re-evaluating evaluation", NeurIPS 2018,
    but relative to any ranking in place of ratings whose differences are the outcomes, since these leave a
    rest in games in which the better always wins.

    outcomes: (players, opponents), finite.
    """
    centered = outcomes - outcomes.mean(axis=0)  # how strong an opponent is does not matter
    variation = float((centered**2).sum())
    if variation <= 1e-12 * max(1.0, float((outcomes**2).sum())):
        return 0.0
    return float(((outcomes - fit_ranking(outcomes)) ** 2).sum()) / variation


def fit_ranking(outcomes: Values) -> Values:
    """Return the outcomes nearest to these in which better players do better against every opponent.

    Players are ranked by their means; for each opponent it is the isotonic regression.

    outcomes: (players, opponents), finite.
    """
    from scipy.optimize import isotonic_regression

    order = np.argsort(outcomes.mean(axis=1), kind="stable")
    rows = np.ascontiguousarray(outcomes[order].T)
    fitted = np.empty_like(outcomes)
    fitted[order] = np.stack([isotonic_regression(row).x for row in rows]).T
    return fitted


def _find_null_range(values: Values, random: np.random.Generator) -> tuple[float, float]:
    """Return the range of the cyclic share in games without cycles that have the noise of the episodes."""
    episodes = values.shape[2]
    outcomes = values.mean(axis=2)
    fitted = fit_ranking(outcomes)
    noise = (values - outcomes[:, :, np.newaxis]) * np.sqrt(episodes / (episodes - 1))
    # All matches have the same seeds, so seeds are resampled, not cells. With cells, what a seed does to all
    # matches alike would count as noise of each, and hide cycles.
    shares = []
    for _ in range(_RESAMPLES):
        drawn = np.bincount(random.integers(episodes, size=episodes), minlength=episodes) / episodes
        shares.append(cyclic_share(fitted + noise @ drawn))
    low, high = _interval(np.array(shares))
    return float(low), float(high)


def _interval(samples: Values) -> tuple[Values, Values]:
    """Return the limits of the central 95 % of samples, along the first axis."""
    tail = (1 - _LEVEL) / 2
    low, high = np.quantile(samples, [tail, 1 - tail], axis=0)
    return np.asarray(low), np.asarray(high)
