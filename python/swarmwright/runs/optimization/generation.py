"""The progress of an optimization after a generation: what a callback gets."""

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
    """The progress of an optimization, after a generation: what a callback of `optimize` gets.

    Fitness is in units of the simulation, more is better.
    """

    generation: int
    """Index of the generation, from 0."""
    generations: int | None
    """Generations of the whole run; None where only evaluations or seconds are limited."""
    best: float
    """Best fitness in the population; NaN where all of it failed."""
    mean: float
    """Mean fitness of the population, failed members left out; NaN where all failed."""
    best_so_far: float
    """Best fitness since the start of the run; where members are evaluated again, that of the best one
    now."""
    failed: int
    """Candidates of this generation whose evaluation failed: in at least one episode."""
    failed_so_far: int
    """Candidates whose evaluation failed since the start."""
    evaluations: int
    """Candidates evaluated since the start, failed ones included."""
    seconds: float
    """Seconds since the start, or since the run was resumed."""
    evaluations_per_second: float
    """Candidates per second over about the last two seconds, or since the generation before where that is
    longer ago; at most since the start."""
    seconds_left: float
    """Seconds until the nearest limit is reached, estimated."""
    waiting_for: str
    """What the evaluation waited for last; empty when it waited for nothing."""
    budget: Limit = "generations"
    """Which limit is nearest: generations, evaluations or seconds."""
    share: float = 0.0
    """Share of that limit which is used, 0 to 1."""


def how_far(budget: Budget, last: Generation | None, *, short: bool = False) -> str:
    """Return how much is used of the budget that ends the run first: `3 of 20 generations`."""
    done = 0 if last is None else last.generation + 1
    limit = budget.nearest(0, 0, 0.0)[0] if last is None else last.budget
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


def goes_on(returned: object) -> bool:
    """Return whether a run goes on after a callback: unless that returned False, NumPy's included.

    Raises InputError when it returned anything else than True, False and None.
    """
    if returned is None or isinstance(returned, bool | np.bool_):
        return returned is None or bool(returned)
    what = describe_value(returned)
    if inspect.iscoroutine(returned):
        what = f"a coroutine, {returned.__qualname__}, which would not be awaited"
        returned.close()
    raise InputError(f"on_generation: returned {what}; return False to end the run, or else True or None")
