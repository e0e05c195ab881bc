"""The progress of an optimization after a generation, as passed to callbacks."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swarmwright.common.arguments import describe_value
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_duration
from swarmwright.experiment.budget import Budget, Limit


@dataclass(frozen=True, kw_only=True)
class Generation:
    """The progress of an optimization after a generation, passed to the callback of `optimize`.

    Fitness is in units of the simulation; larger is better.
    """

    generation: int
    """Index of the generation, from 0."""
    generations: int | None
    """Generations of the whole run; None if only evaluations or seconds are limited."""
    best: float
    """Best fitness in the population; NaN if all members failed."""
    mean: float
    """Mean fitness of the population without failed members; NaN if all failed."""
    best_so_far: float
    """Best fitness since the start of the run; with re-evaluation, of the currently best member."""
    failed: int
    """Candidates of this generation that failed in at least one episode."""
    failed_so_far: int
    """Failed candidates since the start."""
    evaluations: int
    """Candidates evaluated since the start, including failed ones."""
    seconds: float
    """Seconds since the start, or since the run was resumed."""
    evaluations_per_second: float
    """Candidates per second over about the last two seconds; longer if the last generation took longer."""
    seconds_left: float
    """Estimated seconds until the nearest limit is reached."""
    waiting_for: str
    """What the evaluation waited for last; empty if nothing."""
    budget: Limit = "generations"
    """The nearest limit: generations, evaluations or seconds."""
    share: float = 0.0
    """Used share of the nearest limit, 0 to 1."""


def format_progress(budget: Budget, last: Generation | None, *, short: bool = False) -> str:
    """Format the used part of the budget that ends the run first: `3 of 20 generations`."""
    done = 0 if last is None else last.generation + 1
    limit = budget.find_nearest(0, 0, 0.0)[0] if last is None else last.budget
    if limit == "generations":
        whole = budget.generations
        return f"{done}/{whole}" if short else f"{done} of {whole} generations"
    if limit == "evaluations":
        used = 0 if last is None else last.evaluations
        return f"{used}/{budget.evaluations}" if short else f"{used} of {budget.evaluations} evaluations"
    seconds = budget.seconds or 0.0
    used_time, whole_time = format_duration((last.share if last else 0.0) * seconds), format_duration(seconds)
    return f"{used_time} of {whole_time}" if short else f"{done} generations, {used_time} of {whole_time}"


OnGeneration = Callable[[Generation], bool | None]
"""Called after each generation; False ends the run."""


def should_continue(returned: object) -> bool:
    """Return whether to continue after a callback that returned True, False, a NumPy bool or None.

    Raises InputError for any other returned value.
    """
    if returned is None or isinstance(returned, bool | np.bool_):
        return returned is None or bool(returned)
    value = describe_value(returned)
    if inspect.iscoroutine(returned):
        value = f"a coroutine, {returned.__qualname__}, which would not be awaited"
        returned.close()
    raise InputError(
        f"on_generation: returned {value}; return False to end the run, True or None to continue"
    )
