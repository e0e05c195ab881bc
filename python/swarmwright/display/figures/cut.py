"""Axis limits that leave out poor first values, so that the rest is legible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_BEGINNING_SHARE = 0.1
"""Share of the x axis that is a curve's beginning, which may be cut."""
_LARGEST_SPAN_RATIO = 1.5
"""Up to how many times the span of the rest the whole axis is drawn uncut."""
_LARGEST_DROP_RATIO = 2.0
"""Up to how many times the height of a band a line may lie below it, so that an axis has both."""
_FEWEST_POINTS = 8
"""Points of a curve below which nothing is cut."""

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
        return _note("the beginning", self.least)


def _note(what: str, least: float) -> str:
    return f"↓ {what} reaches down to {least + 0.0:.4g}".replace("-", "−")


def far_below(x: Values, low: Values, high: Values, line: Values) -> str | None:
    """Return in words how far a line lies below a band, where the band would be squashed if an axis had both.

    None where it is near, or where only its first tenth is so low, which `cut` leaves out.

    x: ascending, (points,), like all others. low: of the band. high: of the band. line: what is tested.
    """
    known = np.isfinite(low) & np.isfinite(high) & np.isfinite(line)
    if not known.any():
        return None
    later = known & (x >= x[known][0] + _BEGINNING_SHARE * (x[known][-1] - x[known][0]))
    least, bottom, top = float(line[later].min()), float(low[later].min()), float(high[later].max())
    span = top / _LARGEST_SPAN_RATIO - bottom / _LARGEST_SPAN_RATIO  # neither overflows
    below = bottom / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO
    if span <= 0 or below <= _LARGEST_DROP_RATIO * span:
        return None
    return _note("the mean", float(line[known].min()))


def cut(curves: Sequence[tuple[Values, Values, Values]]) -> Cut | None:
    """Return where an axis begins so that first values do not dominate it; None: nothing needs to be cut.

    That is so if all values span more than 1.5 times the range of those after a curve's first tenth.

    curves: of each x, ascending, and the least and the greatest value there, (points,) each.
    """
    lows, highs, leasts = [], [], []
    for x, bottom, top in curves:
        known = np.isfinite(bottom) & np.isfinite(top)
        if np.count_nonzero(known) < _FEWEST_POINTS:
            return None
        later = known & (x >= x[known][0] + _BEGINNING_SHARE * (x[known][-1] - x[known][0]))
        lows.append(float(bottom[later].min()))
        highs.append(float(top[later].max()))
        leasts.append(float(bottom[known].min()))
    if not lows:
        return None
    low, high, least = min(lows), max(highs), min(leasts)
    span = high / _LARGEST_SPAN_RATIO - low / _LARGEST_SPAN_RATIO  # neither overflows
    if span <= 0 or (high / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO) <= _LARGEST_SPAN_RATIO * span:
        return None
    spare = 0.1 * _LARGEST_SPAN_RATIO * span
    return Cut(low - spare, high + spare, least)
