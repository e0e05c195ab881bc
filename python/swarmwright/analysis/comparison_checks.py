"""What cannot be compared is refused."""

from collections.abc import Iterable, Sequence
from typing import get_args

from swarmwright.analysis.after_evaluations import by_generation
from swarmwright.analysis.episodes import episodes_to_begin
from swarmwright.analysis.indicators import By
from swarmwright.common.errors import InputError
from swarmwright.common.problems import shown
from swarmwright.runs.post_evaluation import EPISODES
from swarmwright.runs.run import Run
from swarmwright.runs.validation import command_to_validate


def check_options(
    at: int | None,
    at_episodes: int | None,
    by: object,
    reference: object,
    offset: object,
    *,
    held_out: bool,
) -> None:
    """Raise InputError for options of `compare` that are wrong or contradict each other."""
    for name, value in (("at", at), ("at_episodes", at_episodes)):
        if value is not None and value < 1:
            raise InputError(f"{name}: must be at least 1, not {value}")
    if at_episodes is not None and (at is not None or held_out or by != "fitness"):
        raise InputError(
            "at_episodes: compares the best recorded fitness after so many episodes; leave out at, held_out "
            "and by, or leave out at_episodes"
        )
    kinds = get_args(By)
    if by not in kinds:
        raise InputError(f"by: must be one of {', '.join(kinds)}, not {shown(by)}")
    if held_out and by != "fitness":
        raise InputError(
            "held_out: compares fitness, which validations have; leave out held_out, or leave out by"
        )
    if reference is not None and by != "hypervolume":
        raise InputError(
            "reference: is the reference point of hypervolume; leave it out, or give by='hypervolume'"
        )
    if offset is not None and by != "qd_score":
        raise InputError("offset: is that of the QD score; leave it out, or give by='qd_score'")


def check_begun(runs: Sequence[Run], at: int) -> None:
    """Raise InputError where a run had no finished generation, which it needs, after so many evaluations."""
    slowest = max(filter(by_generation, runs), key=lambda run: run.history[0].evaluations, default=None)
    if slowest is not None and at < (needed := slowest.history[0].evaluations):
        raise InputError(
            f"at {at} evaluations {slowest.path} had no finished generation yet; compare at {needed} or later"
        )


def check_begun_in_episodes(runs: Sequence[Run], episodes: int) -> None:
    """Raise InputError where a run had nothing to compare after so many episodes."""
    for run in runs:
        needed = episodes_to_begin(run)
        if episodes < needed:
            raise InputError(
                f"at_episodes: {run.path} had nothing to compare after {episodes:,} episodes; compare at "
                f"{needed:,} or later"
            )


def check_validated(runs: Sequence[Run], at: int | None) -> None:
    """Raise InputError where a run was not validated, or is not compared at its end."""
    if at is not None:
        raise InputError(
            "at: the best candidates at the end of runs are validated; leave out at, or leave out held_out"
        )
    missing = [run for run in runs if run.validation is None]
    if missing:
        names = ", ".join(str(run.path) for run in missing[:3])
        others = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        command = command_to_validate(missing[0], _episodes(runs))
        raise InputError(f"{names}{others}: not validated on held-out seeds; `{command}` does it")


def _episodes(runs: Iterable[Run]) -> int:
    """Return in how many held-out episodes a run is to be validated, to be compared with others."""
    return max((len(run.unseen.seeds) for run in runs if run.unseen is not None), default=EPISODES)
