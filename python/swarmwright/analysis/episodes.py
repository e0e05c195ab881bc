"""Number of episodes that a run's evaluations took, which is their cost in simulation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.formatting import format_count
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.runs.failures import count_episodes, iterate_episode_counts
from swarmwright.runs.instances import averages_instances
from swarmwright.runs.run import Run


def fitness_at(run: Run, evaluations: int | None = None) -> tuple[float, int]:
    """Return the best fitness within a number of evaluations, NaN if there is none, and the number counted.

    Fewer evaluations count if the run has fewer, or if only finished generations count, see
    `is_compared_by_generation`.

    evaluations: None for the whole run.
    """
    history = run.history
    if evaluations is not None:
        history = [summary for summary in history if summary.evaluations <= evaluations]
    done, best = (history[-1].evaluations, history[-1].best_so_far) if history else (0, math.nan)
    if (
        evaluations is not None
        and done < min(evaluations, run.evaluations)
        and not is_compared_by_generation(run)
    ):
        # Within a generation, evaluations are recorded in the order in which the method requested them.
        end = min(evaluations, run.evaluations)
        best, done = float(np.fmax(best, run._store.best_fitness(done, end))), end
    return best if math.isfinite(best) else math.nan, done


def is_compared_by_generation(run: Run) -> bool:
    """Return whether the best of a run is known only after generations, since its fitness may change."""
    return run.experiment.ranking.reevaluate or averages_instances(run.experiment)


_Numbers: TypeAlias = NDArray[np.int64]

_known: WeakKeyDictionary[Run, tuple[_Numbers, _Numbers]] = WeakKeyDictionary()
"""Results of `_cumulate_by_generation`, which reads every evaluation of a run."""


def episodes_of(run: Run, evaluations: int) -> int:
    """Return the number of episodes that a run's first `evaluations` evaluations took.

    Episodes that a race skipped do not count, nor do validations and the other simulation of a ranking.
    """
    ranking = run.experiment.ranking
    if not isinstance(ranking, RaceOptions):
        return evaluations * ranking.episodes
    ends, cumulative = _cumulate_by_generation(run)
    generation = int(np.searchsorted(ends, evaluations, side="right")) - 1
    rest = evaluations - int(ends[generation])
    return int(cumulative[generation]) + (int(_count_episodes(run, generation)[:rest].sum()) if rest else 0)


def evaluations_within(run: Run, episodes: int) -> int:
    """Return the number of a run's first evaluations that took at most this many episodes."""
    ranking = run.experiment.ranking
    if not isinstance(ranking, RaceOptions):
        return min(episodes // ranking.episodes, run.evaluations)
    ends, cumulative = _cumulate_by_generation(run)
    generation = int(np.searchsorted(cumulative, episodes, side="right")) - 1
    left = episodes - int(cumulative[generation])
    within = np.searchsorted(np.cumsum(_count_episodes(run, generation)), left, side="right")
    return int(ends[generation] + within)


def _cumulate_by_generation(run: Run) -> tuple[_Numbers, _Numbers]:
    """Return numbers of evaluations and their episodes, before each generation of a race and at the end."""
    if run not in _known:
        counts, cumulative = np.zeros((2, run.generations), np.int64)
        if run.experiment.ranking.failure_fitness is not None:
            for generation_counts in iterate_episode_counts(run):
                counts[generation_counts.generation], cumulative[generation_counts.generation] = (
                    len(generation_counts.episodes),
                    generation_counts.episodes.sum(),
                )
        else:
            for part in run._store.rows():
                cached = part.generation < run.generations  # the run may have more later if it continues
                np.add.at(counts, part.generation[cached], 1)
                np.add.at(
                    cumulative,
                    part.generation[cached],
                    _cumulate_episodes(part.episodes, part.fitness)[cached],
                )
        _known[run] = np.concatenate([[0], np.cumsum(counts)]), np.concatenate([[0], np.cumsum(cumulative)])
    return _known[run]


def _count_episodes(run: Run, generation: int) -> _Numbers:
    """Return the number of episodes of each evaluation of a generation; empty if it does not exist."""
    ranking = run.experiment.new_ranking()
    counts = [
        _cumulate_episodes(row.episodes, row.fitness)
        if ranking.options.failure_fitness is None
        else count_episodes(row, ranking).episodes
        for row in run._store.read_generation(generation)
    ]
    return np.concatenate(counts) if counts else np.zeros(0, np.int64)


def _cumulate_episodes(episodes: NDArray[np.float64], fitness: NDArray[np.float64]) -> _Numbers:
    """Return the number of episodes of evaluations; a failed candidate took all of them."""
    cumulative: _Numbers = np.where(
        np.isfinite(fitness), (~np.isnan(episodes)).sum(axis=1), episodes.shape[1]
    )
    return cumulative


def episodes_to_begin(run: Run) -> int:
    """Return the number of episodes after which a run has something to compare."""
    return episodes_of(run, run.history[0].evaluations if is_compared_by_generation(run) else 1)


def limit(run: Run, at: int | None, at_episodes: int | None) -> int | None:
    """Return the number of compared evaluations of a run, from that of evaluations or episodes; None: all."""
    return at if at_episodes is None else evaluations_within(run, at_episodes)


Kind = Literal["unfinished", "empty", "unreadable", "missing"]
_NAMED = 5
"""Number of runs that a note names."""
_STATES = {"running": "still running", "interrupted": "interrupted", "killed": "killed", "failed": "failed"}
"""Descriptions of the states of unfinished runs."""


@dataclass(frozen=True)
class LeftOut:
    """A run that is excluded from a comparison."""

    path: Path
    """Folder of the run."""
    kind: Kind
    """Reason: unfinished, empty (no finished generation), unreadable, or missing in its sweep."""
    reason: str
    """The reason in words, such as `failed after 40 evaluations`."""
    label: str = ""
    """Label of its group; empty if unknown."""
    seed: int | None = None
    """Seed of the run; None if unknown."""
    evaluations: int = 0
    """Number of its evaluations."""

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "run": str(self.path), "group": self.label or None, "seed": self.seed, "reason": self.reason,
            "evaluations": self.evaluations,
        }  # fmt: skip


def find_exclusion(
    run: Run, label: str, at: int | None, at_episodes: int | None, *, unfinished: bool
) -> LeftOut | None:
    """Return a run as an excluded one with the reason; None if it counts.

    Args:
        run: the run.
        label: label of its group.
        at: evaluations after which runs are compared; a run with that many counts, finished or not.
        at_episodes: the same in episodes.
        unfinished: whether unfinished runs count with what they have.
    """
    seed = run.experiment.seed
    if not run.history:
        return LeftOut(run.path, "empty", "holds no finished generation", label, seed)
    done = run.evaluations
    enough = (at is not None and done >= at) or (
        at_episodes is not None and episodes_of(run, done) >= at_episodes
    )
    if unfinished or enough:
        return None
    if run.interrupted:
        state = _STATES[run.state]
    elif run.ended_since_opened:
        state = "opened before it ended"
    else:
        return None
    reason = f"{state}, {format_count(done, 'evaluation')}"
    return LeftOut(run.path, "unfinished", reason, label, seed, done)


def notes(left: Sequence[LeftOut]) -> list[str]:
    """Return notes on excluded runs, and on how to count them."""
    sentences = []
    unfinished = [run for run in left if run.kind == "unfinished"]
    if unfinished:
        sentences.append(
            f"{_runs(unfinished)} left out because {'it has' if len(unfinished) == 1 else 'they have'} not "
            f"finished: {_format_runs(unfinished)}; `swarmwright resume RUN` continues a run, --at N "
            "compares all runs that have N evaluations, and --unfinished counts runs with what they have"
        )
    others = [run for run in left if run.kind != "unfinished"]
    if others:
        sentences.append(f"{_runs(others)} left out: {_format_runs(others)}")
    return sentences


def _runs(left: Sequence[LeftOut]) -> str:
    return f"{format_count(len(left), 'run')} {'is' if len(left) == 1 else 'are'}"


def _format_runs(left: Sequence[LeftOut]) -> str:
    more = f" and {len(left) - _NAMED:,} more" if len(left) > _NAMED else ""
    return "; ".join(f"{run.path} ({run.reason})" for run in left[:_NAMED]) + more
