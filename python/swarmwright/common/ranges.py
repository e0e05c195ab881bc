"""What the numbers -1 and 1 of a sensor or actuator stand for, where a simulation scales them."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

CONVERSION = (
    "A number that is -1 to 1 for LOW to HIGH is scaled: -1 stands for LOW, 1 for HIGH.",
    "VALUE = LOW + (X + 1) / 2 * (HIGH - LOW), and X = 2 * (VALUE - LOW) / (HIGH - LOW) - 1.",
)
"""Lines that say in every form of an exported controller how values become its numbers."""


class Range(NamedTuple):
    """What -1 and 1 stand for: value = low + (x + 1) / 2 * (high - low)."""

    low: float
    """May be above `high`, of something that is turned round."""
    high: float
    unit: str = ""
    """Of both; empty where it is not known."""

    @property
    def words(self) -> str:
        """The range as texts have it: `0 to 100 N`."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{shortest_decimal(self.low)} to {shortest_decimal(self.high)}{unit}"

    @property
    def scaled_words(self) -> str:
        """What texts say of a scaled number: `-1 to 1 for 0 to 100 N`."""
        return f"-1 to 1 for {self.words}"

    @property
    def to_value(self) -> tuple[float, float]:
        """Factor and summand by which a number from -1 to 1 becomes a value."""
        return (self.high - self.low) / 2, (self.high + self.low) / 2

    @property
    def from_value(self) -> tuple[float, float]:
        """Factor and summand by which a value becomes a number from -1 to 1."""
        width = self.high - self.low
        return 2 / width, -(self.high + self.low) / width

    @classmethod
    def of(cls, value: Any) -> "Range | None":  # noqa: ANN401 - whatever a class or a file says
        """Return a range from None, (low, high) or (low, high, unit). Raises ValueError for others."""
        if value is None:
            return None
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise ValueError(f"{value!r} found, expected (low, high) or (low, high, unit), or None")
        given = list(value)
        unit = given.pop() if len(given) == 3 else ""
        if len(given) == 2 and isinstance(unit, str) and all(map(_is_finite, given)):
            low, high = map(float, given)
            if _is_width(low, high):
                return cls(low, high, unit)
        raise ValueError(
            f"{value!r} found, expected (low, high) or (low, high, unit): two different finite numbers"
        )

    @classmethod
    def scaled(cls, factor: float, summand: float, unit: str = "") -> "Range | None":
        """Return the range of `x * factor + summand`; None where x is the value itself, or there is none."""
        low, high = summand - factor, summand + factor
        if (low, high) == (-1.0, 1.0) or not _is_width(low, high):
            return None
        return cls(low, high, unit)


def ranges_of(value: Any, count: int) -> tuple[Range | None, ...]:  # noqa: ANN401 - whatever a class or a file says
    """Return ranges of sensors or actuators, one for each or none at all. Raises ValueError for others."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(f"{value!r} found, expected a list of {count} ranges")
    ranges = tuple(Range.of(ends) for ends in value)
    if ranges and len(ranges) != count:
        raise ValueError(f"{len(ranges)} ranges found, expected {count}")
    return ranges


def intersect_ranges(rows: Sequence[Sequence[Range | None]]) -> tuple[Range | None, ...]:
    """Return the ranges on which all rows that are long enough agree; None for the others."""
    columns = (
        {row[index] for row in rows if index < len(row)} for index in range(max(map(len, rows), default=0))
    )
    return tuple(next(iter(found)) if len(found) == 1 else None for found in columns)


def _is_finite(value: Any) -> bool:  # noqa: ANN401 - whatever a class or a file says
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that no float holds
        return False


def _is_width(low: float, high: float) -> bool:
    width = high - low
    return math.isfinite(width) and width != 0 and math.isfinite(2 / width)


def shortest_decimal(value: float) -> str:
    """Return a number in few digits that read back as the same one, or the same binary32."""
    short = f"{value + 0.0:g}"
    if float(short) == value:
        return short
    with np.errstate(over="ignore"):
        single = np.float32(value)
    return (str(single) if float(single) == value else repr(value)).removesuffix(".0")
