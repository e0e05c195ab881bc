"""Runs that do not count in a comparison: one rule for commands, sweeps and Python.

A run counts when it has finished: its budget is used, its target reached, or a callback stopped it. Runs that
failed, were interrupted or killed, are still running, have no finished generation, cannot be read or are
missing in their sweep are left out. A note names them with the reason, and tables have their number.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from swarmwright.analysis.episodes import episodes_of
from swarmwright.common.formatting import counted
from swarmwright.runs.run import Run

Kind = Literal["unfinished", "empty", "unreadable", "missing"]
_NAMED = 5
"""Runs that a note names."""
_STATES = {"running": "still running", "interrupted": "interrupted", "killed": "killed", "failed": "failed"}
"""States of a run that has not finished, in words."""


@dataclass(frozen=True)
class LeftOut:
    """A run that does not count in a comparison."""

    path: Path
    """Its folder."""
    kind: Kind
    """Why: it has not finished, has no finished generation, cannot be read, or is missing in its sweep."""
    reason: str
    """The same in words, such as `failed after 40 evaluations`."""
    label: str = ""
    """Its group; empty where that is not known."""
    seed: int | None = None
    """Seed of the run; None where that is not known."""
    evaluations: int = 0
    """Evaluations that it has."""

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "run": str(self.path), "group": self.label or None, "seed": self.seed, "reason": self.reason,
            "evaluations": self.evaluations,
        }  # fmt: skip


def left_out(
    run: Run, label: str, at: int | None, at_episodes: int | None, *, unfinished: bool
) -> LeftOut | None:
    """Return a run as one that does not count, with the reason; None where it counts.

    Args:
        run: which.
        label: of its group.
        at: evaluations after which runs are compared: a run that has so many counts, whatever came of it.
        at_episodes: the same with episodes.
        unfinished: whether runs that have not finished count with what they have.
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
    reason = f"{state}, {counted(done, 'evaluation')}"
    return LeftOut(run.path, "unfinished", reason, label, seed, done)


def notes(left: Sequence[LeftOut]) -> list[str]:
    """Return which runs are left out, and how they would count."""
    found = []
    unfinished = [one for one in left if one.kind == "unfinished"]
    if unfinished:
        found.append(
            f"{_runs(unfinished)} left out because {'it has' if len(unfinished) == 1 else 'they have'} not "
            f"finished: {_named(unfinished)}; `swarmwright resume RUN` continues a run, --at N compares all "
            "runs that have N evaluations, and --unfinished counts runs with what they have"
        )
    others = [one for one in left if one.kind != "unfinished"]
    if others:
        found.append(f"{_runs(others)} left out: {_named(others)}")
    return found


def _runs(left: Sequence[LeftOut]) -> str:
    return f"{counted(len(left), 'run')} {'is' if len(left) == 1 else 'are'}"


def _named(left: Sequence[LeftOut]) -> str:
    more = f" and {len(left) - _NAMED:,} more" if len(left) > _NAMED else ""
    return "; ".join(f"{one.path} ({one.reason})" for one in left[:_NAMED]) + more
