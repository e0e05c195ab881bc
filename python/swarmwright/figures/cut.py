"""Axis limits that leave out poor first values, so that the rest is legible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_FIRST = 0.1
_SQUASHED = 1.5
_FEW = 8  # points of a curve below which nothing is cut

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """What an axis leaves out at its lower end."""

    low: float
    """Where the axis begins."""
    high: float
    """Where it ends, with a margin above the greatest value."""
    least: float
    """The least value, below the axis."""

    @property
    def note(self) -> str:
        """What is left out, in words."""
        return f"↓ the beginning reaches down to {self.least + 0.0:.4g}".replace("-", "−")


def cut(curves: Sequence[tuple[Values, Values, Values]]) -> Cut | None:
    """Return where an axis begins so that first values do not dominate it; None: nothing needs to be cut.

    That is so if all values span more than 1.5 times the range of those after a curve's first tenth.

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
    span = high / _SQUASHED - low / _SQUASHED  # neither overflows
    if span <= 0 or (high / _SQUASHED - least / _SQUASHED) <= _SQUASHED * span:
        return None
    spare = 0.1 * _SQUASHED * span
    return Cut(low - spare, high + spare, least)
