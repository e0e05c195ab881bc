"""Physical ranges of sensors and actuators that a simulation scales to -1 and 1."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

CONVERSION = (
    "A number that is -1 to 1 for LOW to HIGH is scaled: -1 stands for LOW, 1 for HIGH.",
    "VALUE = LOW + (X + 1) / 2 * (HIGH - LOW), and X = 2 * (VALUE - LOW) / (HIGH - LOW) - 1.",
)
"""Lines in every exported controller on the conversion of values."""


class Range(NamedTuple):
    """The values for -1 and 1: value = low + (x + 1) / 2 * (high - low)."""

    low: float
    """May be above `high`, for a reversed range."""
    high: float
    unit: str = ""
    """Unit of both; empty if unknown."""

    @property
    def words(self) -> str:
        """The range as text: `0 to 100 N`."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{shortest_decimal(self.low)} to {shortest_decimal(self.high)}{unit}"

    @property
    def scaled_words(self) -> str:
        """The scaling as text: `-1 to 1 for 0 to 100 N`."""
        return f"-1 to 1 for {self.words}"

    @property
    def to_value(self) -> tuple[float, float]:
        """Factor and summand that convert a number from -1 to 1 to a value."""
        return (self.high - self.low) / 2, (self.high + self.low) / 2

    @property
    def from_value(self) -> tuple[float, float]:
        """Factor and summand that convert a value to a number from -1 to 1."""
        width = self.high - self.low
        return 2 / width, -(self.high + self.low) / width

    @classmethod
    def parse(cls, value: Any) -> "Range | None":  # noqa: ANN401 - whatever a class or a file says
        """Return a range from None, (low, high) or (low, high, unit). Raises ValueError for other values."""
        if value is None:
            return None
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise ValueError(f"{value!r} found, expected (low, high) or (low, high, unit), or None")
        values = list(value)
        unit = values.pop() if len(values) == 3 else ""
        if len(values) == 2 and isinstance(unit, str) and all(map(_is_finite, values)):
            low, high = map(float, values)
            if _is_width(low, high):
                return cls(low, high, unit)
        raise ValueError(
            f"{value!r} found, expected (low, high) or (low, high, unit): two different finite numbers"
        )

    @classmethod
    def from_scale(cls, factor: float, summand: float, unit: str = "") -> "Range | None":
        """Return the range of `x * factor + summand`; None if x is the value itself, or without a range."""
        low, high = summand - factor, summand + factor
        if (low, high) == (-1.0, 1.0) or not _is_width(low, high):
            return None
        return cls(low, high, unit)


def ranges_of(value: Any, count: int) -> tuple[Range | None, ...]:  # noqa: ANN401 - whatever a class or a file says
    """Parse ranges of sensors or actuators, one for each or none. Raises ValueError for other values."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(f"{value!r} found, expected a list of {count} ranges")
    ranges = tuple(Range.parse(ends) for ends in value)
    if ranges and len(ranges) != count:
        raise ValueError(f"{len(ranges)} ranges found, expected {count}")
    return ranges


def intersect_ranges(rows: Sequence[Sequence[Range | None]]) -> tuple[Range | None, ...]:
    """Return the ranges on which all sufficiently long rows agree; None elsewhere."""
    columns = (
        {row[index] for row in rows if index < len(row)} for index in range(max(map(len, rows), default=0))
    )
    return tuple(next(iter(choices)) if len(choices) == 1 else None for choices in columns)


def _is_finite(value: Any) -> bool:  # noqa: ANN401 - whatever a class or a file says
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond float
        return False


def _is_width(low: float, high: float) -> bool:
    width = high - low
    return math.isfinite(width) and width != 0 and math.isfinite(2 / width)


def shortest_decimal(value: float) -> str:
    """Return the shortest decimal that reads back as the same number, or the same binary32."""
    short = f"{value + 0.0:g}"
    if float(short) == value:
        return short
    with np.errstate(over="ignore"):
        single = np.float32(value)
    return (str(single) if float(single) == value else repr(value)).removesuffix(".0")
