"""Axes of charts: limits, round numbers for ticks, and how they are written."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_LARGEST = 7e307  # a range of twice that, and margins, are still numbers
_FAR = 10.0  # ranges below an axis at which what lies lower is drawn, unseen
_FIRST = 0.1
_SQUASHED = 1.5
_FEW = 8  # points of a curve below which nothing is cut
_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
_WHOLE = (1.0, 2.0, 5.0, 10.0)

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Scale:
    """Maps numbers to pixels: `low` is at pixel `start`, `high` at pixel `end`."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Return the pixel of a number; one beyond the limits is taken for the limit."""
        value = min(max(value, self.low), self.high)
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def each(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels of numbers; what lies lower than the axis has pixels beyond its start."""
        values = np.clip(values, self.low - _FAR * (self.high - self.low), self.high)
        return self.start + (values - self.low) / (self.high - self.low) * (self.end - self.start)


def limits(values: NDArray[np.float64], margin: float) -> tuple[float, float]:
    """Return limits around the finite numbers with a share of their range to spare; never the same twice."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    low, high = (min(max(one, -_LARGEST), _LARGEST) for one in (low, high))
    # Closer than what a double tells apart near them is one number.
    spare = (high - low) * margin
    if high - low <= max(abs(low), abs(high)) * 1e-12:
        spare = max(abs(high) * 0.05, 0.05)
    return low - spare, high + spare


@dataclass(frozen=True)
class Cut:
    """What an axis leaves out at its lower end."""

    low: float
    """Where the axis begins."""
    high: float
    """Where it ends, with some room above the greatest value."""
    least: float
    """The least value, below the axis."""

    @property
    def note(self) -> str:
        """What is left out, in words."""
        return _text(f"↓ the beginning reaches down to {self.least:.4g}")


def cut(curves: Sequence[tuple[Values, Values, Values]]) -> Cut | None:
    """Return where an axis begins so that first values do not squash the rest; None: nothing needs to be cut.

    That is so where all values need more than 1.5 times the room of those after a curve's first tenth.

    curves: of each x, ascending, and the least and the greatest value there, (points,) each.
    """
    lows, highs, leasts = [], [], []
    for x, bottom, top in curves:
        known = np.isfinite(bottom) & np.isfinite(top)
        if np.count_nonzero(known) < _FEW:
            return None
        later = known & (x >= x[known][0] + _FIRST * (x[known][-1] - x[known][0]))
        lows.append(float(bottom[later].min()))
        highs.append(float(top[later].max()))
        leasts.append(float(bottom[known].min()))
    if not lows:
        return None
    low, high, least = min(lows), max(highs), min(leasts)
    room = high / _SQUASHED - low / _SQUASHED  # neither overflows
    if room <= 0 or (high / _SQUASHED - least / _SQUASHED) <= _SQUASHED * room:
        return None
    spare = 0.1 * _SQUASHED * room
    return Cut(low - spare, high + spare, least)


def ticks(low: float, high: float, most: int, *, whole: bool = False) -> list[float]:
    """Return at most `most` + 1 round numbers from low to high, at equal distances; whole: integers only."""
    least = (high - low) / most
    power = 10.0 ** math.floor(math.log10(least)) if least >= 1e-300 else 1e-300
    step = next(
        factor * power for factor in (_WHOLE if whole else _ROUND) if factor * power >= least * 0.999999
    )
    step = max(step, 1.0) if whole else step
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def labels(values: list[float]) -> list[str]:
    """Return tick values as text, with as many digits as tell them apart."""
    if len(values) < 2:
        return [_text(f"{value:.6g}") for value in values]
    step, largest = values[1] - values[0], max(map(abs, values))
    if step >= 1e-5 and largest < 1e7:
        places = next((places for places in range(6) if _has(step, places)), 6)
        return [_text(f"{value:.{places}f}") for value in values]
    digits = max(1, math.ceil(math.log10(max(largest / step, 1.0))) + 2)
    return [_text(f"{0.0 if abs(value) < step / 2 else value:.{digits}g}") for value in values]


def _has(step: float, places: int) -> bool:
    shifted = step * 10**places
    return math.isclose(shifted, round(shifted), rel_tol=1e-6)


def _text(number: str) -> str:
    """Write a minus as typographers do; no negative zero."""
    return number.replace("-", "−") if number.strip("-0.") else number.lstrip("-")
