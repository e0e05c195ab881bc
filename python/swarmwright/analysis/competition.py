"""Progress of competitions: do later champions beat earlier ones, or do they go in circles?

Fitness says nothing about it, since the opponents change with it. Therefore champions of all generations of
one side meet those of the other: the master tournament of Nolfi and Floreano, "Coevolving predator and prey
robots: do 'arms races' arise in artificial evolution?", Artificial Life 4(4), 1998. The matches against
earlier opponents alone are those of Cliff and Miller, "Tracking the red queen: measurements of adaptive
progress in co-evolutionary simulations", ECAL 1995.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError
from swarmwright.runs.matches import play, sides_of
from swarmwright.runs.run import Run
from swarmwright.servers.evaluation.base import Progress, Servers

Values = NDArray[np.float64]

FIRST_SEED = 1_000_000_000
"""Default seed of the first episode, after which those of a run are not expected."""
_RESAMPLES = 400
"""Samples of each bootstrap and of the null model."""
_LEVEL = 0.95
_MOST = {"champions": 1000, "episodes": 10_000, "seed": 2**62}
"""Upper limits of arguments."""


@dataclass(frozen=True)
class SideProgress:
    """Champions of a side against all champions of the other side."""

    side: str
    generations: tuple[int, ...]
    """Generations of the champions, ascending."""
    outcomes: Values
    """(generations, generations of the other side): mean fitness of this side over the episodes."""
    means: Values
    """(generations,): mean of the outcomes of each champion."""
    low: Values
    """(generations,): lower limits of their 95 % intervals, from resampled seeds."""
    high: Values
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

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "generations": list(self.generations),
            "means": self.means.tolist(),
            "low": self.low.tolist(),
            "high": self.high.tolist(),
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
    """Progress of both sides of a run."""

    sides: tuple[SideProgress, SideProgress]
    episodes: int
    """Episodes of each match."""
    seed: int
    """Seed of the first."""


@check_arguments
def measure_progress(
    run: Run,
    *,
    champions: int = 30,
    episodes: int = 10,
    seed: int = FIRST_SEED,
    broker: str | None = None,
    prefix: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> CompetitionProgress:
    """Let champions of all generations meet, and measure the progress of both sides.

    Args:
        run: a competition with two sides.
        champions: number of champions of each side, of evenly spaced generations, at least 2.
        episodes: episodes of each match, at least 2, from which the noise is estimated.
        seed: seed of the first episode.
        broker: as in `optimize`.
        prefix: prefix of the topics on the broker; default: the run's.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the run is no competition, has other than two sides, or fewer than two generations.
        RunError: all matches failed, or there is no server.
    """
    for name, value, least in (("champions", champions, 2), ("episodes", episodes, 2), ("seed", seed, 0)):
        if not least <= value <= _MOST[name]:
            raise InputError(f"{name}: must be from {least} to {_MOST[name]}, not {value}")
    names = sides_of(run.experiment)
    if len(names) != 2:
        raise InputError(f"progress compares two sides, but the run has {len(names)}: {', '.join(names)}")
    first, second = (run.champions(name) for name in names)
    if len(first) < 2:
        raise InputError(f"{run.path}: progress needs at least two finished generations, not {len(first)}")
    rows = np.unique(np.linspace(0, len(first) - 1, min(champions, len(first))).round().astype(np.intp))
    generations = [first[row].generation for row in rows]
    joined = np.stack(
        [np.concatenate([first[row].genome, second[column].genome]) for row in rows for column in rows]
    )
    seeds = range(seed, seed + episodes)
    experiment = run.experiment if prefix is None else dataclasses.replace(run.experiment, prefix=prefix)
    fitness = play(
        experiment, joined, seeds, broker=broker, servers=servers, on_progress=on_progress
    ).reshape(len(rows), len(rows), episodes, 2)
    if not np.isfinite(fitness).all():
        failed = int(np.count_nonzero(~np.isfinite(fitness).all(axis=(2, 3))))
        raise RunError(f"{failed} of {len(joined)} matches failed; progress needs all of them")
    parts = (fitness[..., 0], fitness[..., 1].transpose(1, 0, 2))
    own, other = (
        assess(name, generations, np.ascontiguousarray(part)) for name, part in zip(names, parts, strict=True)
    )
    return CompetitionProgress((own, other), episodes, seed)


def assess(side: str, generations: Sequence[int], values: Values) -> SideProgress:
    """Return the progress of a side.

    Args:
        side: its name.
        generations: generations of its champions and of those of the other side.
        values: (generations, generations, episodes) fitness of this side, finite.
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
    return SideProgress(
        side=side,
        generations=tuple(generations),
        outcomes=outcomes,
        means=means,
        low=low,
        high=high,
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
    whole = float((centered**2).sum())
    if whole <= 1e-12 * max(1.0, float((outcomes**2).sum())):
        return 0.0
    return float(((outcomes - fit_ranking(outcomes)) ** 2).sum()) / whole


def fit_ranking(outcomes: Values) -> Values:
    """Return the outcomes nearest to these in which better players do better against every opponent.

    Players are ranked by their means. For each opponent, it is the isotonic regression, by its min-max
    formula.

    outcomes: (players, opponents), finite.
    """
    order = np.argsort(outcomes.mean(axis=1), kind="stable")
    ordered = outcomes[order]
    players = len(ordered)
    sums = np.concatenate([np.zeros((1, ordered.shape[1])), np.cumsum(ordered, axis=0)])
    index = np.arange(players)
    lengths = (index[np.newaxis] - index[:, np.newaxis] + 1).astype(np.float64)
    valid = lengths > 0
    blocks = (sums[np.newaxis, 1:] - sums[:-1, np.newaxis]) / np.where(valid, lengths, 1.0)[..., np.newaxis]
    blocks[~valid] = np.inf  # from a to b, a <= b
    least = np.minimum.accumulate(blocks[:, ::-1], axis=1)[:, ::-1]  # over b >= i
    least[~valid] = -np.inf
    fitted = np.empty_like(outcomes)
    fitted[order] = least.max(axis=0)
    return fitted


def _find_null_range(values: Values, random: np.random.Generator) -> tuple[float, float]:
    """Return the range of the cyclic share in games without cycles that have the noise of the episodes."""
    episodes = values.shape[2]
    outcomes = values.mean(axis=2)
    fitted = fit_ranking(outcomes)
    noise = (values - outcomes[:, :, np.newaxis]) * np.sqrt(episodes / (episodes - 1))
    # All matches have the same seeds, so seeds are resampled, not cells. With cells, what a seed does to all
    # matches alike would count as noise of each, and hide cycles.
    shares = [
        cyclic_share(fitted + noise[:, :, random.integers(episodes, size=episodes)].mean(axis=2))
        for _ in range(_RESAMPLES)
    ]
    low, high = _interval(np.array(shares))
    return float(low), float(high)


def _interval(samples: Values) -> tuple[Values, Values]:
    """Return the limits of the central 95 % of samples, along the first axis."""
    tail = (1 - _LEVEL) / 2
    low, high = np.quantile(samples, [tail, 1 - tail], axis=0)
    return np.asarray(low), np.asarray(high)
