"""Reductions of many numbers to one: last, mean, ..; sums are exact and the same on every machine."""

from __future__ import annotations

import math
from typing import Callable, Sequence


def mean(values: Sequence[float]) -> float:
    """Return the mean."""
    return math.fsum(values) / len(values)


def std(values: Sequence[float]) -> float:
    """Return the population standard deviation."""
    center = mean(values)
    return math.sqrt(math.fsum((value - center) * (value - center) for value in values) / len(values))


FUNCTIONS: dict[str, Callable[[Sequence[float]], float]] = {
    "last": lambda values: values[-1],
    "first": lambda values: values[0],
    "mean": mean,
    "sum": math.fsum,
    "min": min,
    "max": max,
    "std": std,
    "count": lambda values: float(len(values)),
}
"""Reductions of at least one value, by name."""
