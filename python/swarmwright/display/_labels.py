"""Texts beside bodies, which cover neither a body nor each other."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarmwright.display._bodies import Bodies
from swarmwright.display._look import INK, LED, PAPER, STRETCH

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_MOST_LABELS = 200
"""Labels that are drawn."""
_LABEL_CHARACTERS = 24
"""Letters of a label."""
_FONT_SIZE_POINTS = 8.0
"""Of letters, points."""
_LETTER = 0.6
"""Width of a letter as a share of the size, about."""
_GAP_POINTS = 1.5
"""Points between a body and its label."""
_SIDES = ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
"""Where a label can be beside its body, to the right and upwards, in the order in which places are tried."""


class _Box(NamedTuple):
    """A rectangle, in points from the lower left corner of the map."""

    left: float
    low: float
    right: float
    high: float

    def meets(self, other: "_Box") -> bool:
        """Whether it has a part in common with another one."""
        beside = self.right <= other.left or other.right <= self.left
        return not (beside or self.high <= other.low or other.high <= self.low)


class Labels:
    """Labels of bodies, frame after frame: one stays at its side of its body as long as it can.

    scale: points for each metre. least: radius in points of bodies that are drawn as marks.
    """

    def __init__(self, scale: float, *, least: float) -> None:
        self._scale = scale
        self._least = least
        self._sides: dict[int, int] = {}

    def draw(self, axes: "Axes", bodies: Bodies) -> "list[Artist]":
        """Write the labels that have a place; return what was drawn."""
        from matplotlib.patheffects import withStroke

        field = _Box(0.0, 0.0, axes.get_xlim()[1] * self._scale, axes.get_ylim()[1] * self._scale)
        room = _Room(bodies, self._scale, self._least, field)
        texts = [" ".join(text.split())[:_LABEL_CHARACTERS] for text in bodies.labels or ()]
        artists: list[Artist] = []
        for index in [index for index, text in enumerate(texts) if text][:_MOST_LABELS]:
            found = room.take(index, len(texts[index]), self._sides.get(index))
            if found is None:
                continue
            self._sides[index], (right, up) = found
            artists.append(
                axes.annotate(
                    texts[index], (float(bodies.x[index]), float(bodies.y[index])),
                    xytext=(right, up + 0.15 * _FONT_SIZE_POINTS), textcoords="offset points", va="baseline",
                    fontsize=_FONT_SIZE_POINTS, color=INK, zorder=5.0, parse_math=False,
                    path_effects=[withStroke(linewidth=2.0, foreground=PAPER)],
                )
            )  # fmt: skip
        return artists


class _Room:
    """The part of a map that is free for labels. field: the whole of it."""

    def __init__(self, bodies: Bodies, scale: float, least: float, field: _Box) -> None:
        self._radii = np.maximum(bodies.radius * scale, least).astype(np.float64)
        self._x, self._y = bodies.x * np.float64(scale), bodies.y * np.float64(scale)
        # What is not seen cannot be covered, and LEDs lie within robots.
        self._seen = ~bodies.has(LED, STRETCH)
        self._largest = float(self._radii[self._seen].max(initial=0.0))
        self._field = field
        self._taken: list[_Box] = []

    def take(self, index: int, letters: int, before: int | None) -> tuple[int, tuple[float, float]] | None:
        """Return the side at which a body's label is, and where, in points from its middle; None for none.

        letters: of the label. before: the side in the frame before, which is tried first.
        """
        wide, high = _LETTER * _FONT_SIZE_POINTS * letters, _FONT_SIZE_POINTS
        reach = wide + high + self._radii[index] + _GAP_POINTS + self._largest
        x, y = self._x, self._y
        near = np.flatnonzero(self._seen & (abs(x - x[index]) < reach) & (abs(y - y[index]) < reach))
        near = near[near != index]
        for side, box in self._boxes(index, wide, high, before):
            within = box.left >= 0 and box.low >= 0
            within &= box.right <= self._field.right and box.high <= self._field.high
            if not within or any(box.meets(other) for other in self._taken):
                continue
            away = np.hypot(
                x[near] - np.clip(x[near], box.left, box.right), y[near] - np.clip(y[near], box.low, box.high)
            )
            if not (away < self._radii[near]).any():
                self._taken.append(box)
                return side, (float(box.left - x[index]), float(box.low - y[index]))
        return None

    def _boxes(self, index: int, wide: float, high: float, before: int | None) -> Iterator[tuple[int, _Box]]:
        """Yield the sides of a body and the boxes there, that of the frame before first."""
        for side in sorted(range(len(_SIDES)), key=lambda side: side != before):
            right, up = _SIDES[side]
            # A label at a corner of the square around a disc would be far from it.
            away = self._radii[index] * (0.75 if right and up else 1.0) + _GAP_POINTS
            left = float(self._x[index] + right * away - wide * (1 - right) / 2)
            low = float(self._y[index] + up * away - high * (1 - up) / 2)
            yield side, _Box(left, low, left + wide, low + high)
