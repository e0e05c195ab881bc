"""Diagrams of state machines: states on a circle, arrows from state to state, labels that do not overlap.

Lengths are in inches. Labels lie on or beside their arrow, near its source; labels without space are left
out.
"""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.display.figures.style import INK, PAPER, SOFT, new_figure
from swarmwright.display.machines import state_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, low, right, high."""

_FONT_SIZE_POINTS = 9.0  # points, of labels
_LETTER = 0.66 * _FONT_SIZE_POINTS / 72
_LABEL_HEIGHT = 1.25 * _FONT_SIZE_POINTS / 72
_PAD = 0.03  # around a label
_LOOP = 0.52  # length of an arrow from a state to itself
_LEAST_RING = 1.55  # radius of the circle of states
_LEAST_SIZE = 5.6  # width of the note below the diagram
_BENDS = (0.12, 0.2, 0.3, 0.42, 0.55, -0.12, -0.22, -0.32, -0.45, 0.04, -0.04)
"""Bends of an arrow to its right, as a share of its length, in the order in which they are tried."""
_CLEAR = 0.1  # between an arrow and other states
_APART = 0.14  # between an arrow and the one back
_POINTS = 33  # of an arrow

_TOP, _FOOT, _MARGIN = 0.85, 0.35, 0.2
_LIST_LETTER, _LIST_LINE, _LIST_SIZE = 0.0836, 0.174, 9.5
_LOWEST_LIST = 8.0
_MOST_COLUMNS = 3


@dataclass(frozen=True)
class Node:
    """A state, drawn with its number and name, which can be empty; faint: no episode reaches it."""

    name: str = ""
    faint: bool = False


@dataclass(frozen=True)
class Arrow:
    """A transition from a state to another or to itself; an empty label is not drawn."""

    source: int
    target: int
    label: str
    width: float = 1.4
    faint: bool = False


@dataclass(frozen=True)
class _Way:
    """The geometry of an arrow: control points of its path, and points along it."""

    path: tuple[Point, ...]
    along: NDArray[np.float64]


def new_figure_with_list(
    title: str,
    about: str,
    inside: float,
    blocks: Sequence[Sequence[str]],
    *,
    letters: int,
    highest: float = 40.0,
) -> "tuple[Figure, Axes]":
    """Return a figure with a list, and the square axes beside it.

    inside: size of the axes in inches. blocks: lines that stay in one column. letters: number of letters of
    the longest line. highest: largest height in inches; lines that do not fit into three columns of this
    height are left out, and the list says so.
    """
    columns = _columns(
        blocks, int(max(inside, _LOWEST_LIST) / _LIST_LINE), int((highest - _TOP - _FOOT) / _LIST_LINE)
    )
    height = max(inside, _LIST_LINE * max(len(column) for column in columns)) + _TOP + _FOOT
    width = inside + 2 * _MARGIN + len(columns) * (letters * _LIST_LETTER + _MARGIN)
    figure = new_figure(width, height)
    # All positions are in inches.
    figure.set_layout_engine("none")
    axes = figure.add_axes((_MARGIN / width, 1 - (_TOP + inside) / height, inside / width, inside / height))
    for index, column in enumerate(columns):
        left = inside + 2 * _MARGIN + index * (letters * _LIST_LETTER + _MARGIN)
        figure.text(
            left / width, 1 - _TOP / height, "\n".join(column), va="top", fontsize=_LIST_SIZE, color=INK,
            linespacing=1.29, parse_math=False, family="monospace",
        )  # fmt: skip
    style: dict[str, Any] = {"ha": "left", "va": "top", "parse_math": False}
    figure.text(0.15 / width, 1 - 0.14 / height, title, fontsize=13, fontweight="bold", color=INK, **style)
    figure.text(0.15 / width, 1 - 0.45 / height, about, fontsize=10, color=SOFT, **style)
    return figure, axes


def _columns(blocks: Sequence[Sequence[str]], target_lines: int, most: int) -> list[list[str]]:
    """Distribute blocks over columns of about the same height, without empty columns.

    target_lines: lines of a column, exceeded only if there would be too many columns. most: lines of the
    longest column.
    """
    lines = [line for block in blocks for line in block]
    if len(lines) > _MOST_COLUMNS * most:
        omitted = len(lines) - _MOST_COLUMNS * most + 1
        lines = [*lines[:-omitted], f"and {omitted:,} lines more"]
        return [lines[first : first + most] for first in range(0, len(lines), most)]
    count = min(-(-len(lines) // target_lines), _MOST_COLUMNS)
    columns: list[list[str]] = [[]]
    for block in blocks:
        if len(columns) < count and len(columns[-1]) + len(block) / 2 > len(lines) / count:
            columns.append([])
        columns[-1].extend(block)
    if max(map(len, columns)) > most:  # blocks are too long to stay in one column
        return [lines[first : first + most] for first in range(0, len(lines), most)]
    return [column for column in columns if column]


class Diagram:
    """Layout of states, arrows and labels, `size` inches wide and high.

    first_color: index of the colour of state 0.
    """

    def __init__(self, nodes: Sequence[Node], arrows: Sequence[Arrow], first_color: int = 0) -> None:
        count = len(nodes)
        self._nodes, self._arrows = nodes, arrows
        self._first_color = first_color
        named = any(node.name for node in nodes)
        self.radius = 0.47 if named else 0.29
        longest = max((_width(arrow.label) for arrow in arrows), default=0.0)
        gap = 2 * self.radius + max(0.75 if named else 0.7, longest + 0.15)
        self._ring = 0.0 if count == 1 else max(_LEAST_RING, gap / (2 * math.sin(math.pi / count)))
        self.size = max(2 * (self._ring + self.radius + _LOOP + max(longest / 2, 0.2) + 0.1), _LEAST_SIZE)
        self.positions = [position_of(index, count, self._ring) for index in range(count)]
        self.ways = self._route_arrows()
        self.labels = self._place_labels()

    def _route_arrows(self) -> list[_Way]:
        ways: dict[tuple[int, int], _Way] = {}
        # Short ones first: they have the least choice.
        for arrow in sorted(self._arrows, key=lambda arrow: self._length(arrow.source, arrow.target)):
            if (arrow.source, arrow.target) not in ways:
                back = ways.get((arrow.target, arrow.source))
                ways[arrow.source, arrow.target] = self._way(arrow.source, arrow.target, back)
        return [ways[arrow.source, arrow.target] for arrow in self._arrows]

    def _length(self, source: int, target: int) -> float:
        return math.dist(self.positions[source], self.positions[target])

    def _way(self, source: int, target: int, back: _Way | None) -> _Way:
        """Return the first route that is clear of other states and of the arrow back; else the clearest."""
        if source == target:
            return self._loop(self.positions[source])
        others = np.array([at for index, at in enumerate(self.positions) if index not in {source, target}])
        best: tuple[float, _Way] | None = None
        for bend in _BENDS:
            way = _arc(self.positions[source], self.positions[target], bend, self.radius)
            space = 1.0
            if len(others):
                space = _nearest(way.along, others) - self.radius - _CLEAR
            if back is not None:
                middles = way.along[_POINTS // 2], back.along[_POINTS // 2]
                space = min(space, math.dist(*middles) - _APART)
            if best is None or space > best[0]:
                best = space, way
            if space >= 0:
                break
        assert best is not None
        return best[1]

    def _loop(self, position: Point) -> _Way:
        """Return a route from a state outwards and back."""
        x, y = position
        out = math.atan2(y, x) if (x, y) != (0.0, 0.0) else math.pi / 2
        r = self.radius

        def point(angle: float, radius: float) -> Point:
            return x + radius * math.cos(out + angle), y + radius * math.sin(out + angle)

        # The middle of the curve is a quarter of the state's border and three quarters of its control points.
        far = (r + _LOOP - 0.25 * r * math.cos(0.5)) / 0.75
        wide = math.atan2(0.42, far)
        far /= math.cos(wide)
        path = (point(0.5, r), point(wide, far), point(-wide, far), point(-0.5, r + 0.02))
        t = np.linspace(0, 1, _POINTS)[:, None]
        a, b, c, d = np.array(path)
        along = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        return _Way(path, along)

    def _place_labels(self) -> list[Box | None]:
        """Return the box of each arrow's label; None if there is no space for it."""
        placed: list[Box] = []
        boxes: list[Box | None] = [None] * len(self._arrows)
        # Loops and short arrows have the fewest positions.
        order = sorted(range(len(self._arrows)), key=lambda index: len(self._candidates(index)))
        for index in order:
            if not self._arrows[index].label:
                continue
            box = self._place_label(index, placed)
            boxes[index] = box
            if box is not None:
                placed.append(box)
        return boxes

    def _candidates(self, index: int) -> NDArray[np.float64]:
        """Return candidate centers for a label, best first."""
        arrow, way = self._arrows[index], self.ways[index]
        if arrow.source == arrow.target:
            middle = _POINTS // 2
            return way.along[[middle, middle - 3, middle + 3, middle - 6, middle + 6]]
        length = float(np.hypot(*np.diff(way.along, axis=0).T).sum())
        # Keep away from the head of the arrow.
        last = max(1 - 0.3 / length, 0.55)
        chosen = (np.linspace(0.1, last, 24) * (_POINTS - 1)).round().astype(int)
        middles, ahead = way.along[chosen], np.gradient(way.along, axis=0)[chosen]
        # On the arrow, or else to its right or left.
        side = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1) / np.hypot(*ahead.T)[:, None]
        beside = side * (np.abs(side) @ self._half_size(index) + 0.02)[:, None]
        return np.concatenate([middles, middles + beside, middles - beside])

    def _half_size(self, index: int) -> NDArray[np.float64]:
        """Return half the width and height of a label's box."""
        return np.array([_width(self._arrows[index].label), _LABEL_HEIGHT + 2 * _PAD]) / 2

    def _place_label(self, index: int, placed: Sequence[Box]) -> Box | None:
        """Return a free box for a label, near its state and on few other arrows."""
        half = self._half_size(index)
        middles = self._candidates(index)
        nodes = np.array(self.positions)
        away = np.maximum(np.abs(middles[:, None] - nodes) - half, 0)
        free = (np.hypot(*away.transpose(2, 0, 1)) > self.radius + 0.02).all(axis=1)
        if placed:
            low, high = np.array(placed)[:, :2], np.array(placed)[:, 2:]
            lows, highs = middles[:, None] - half, middles[:, None] + half
            free &= ~np.any(np.all((lows < high) & (highs > low), axis=2), axis=1)
        inside = self.size / 2 - half
        free &= (np.abs(middles) < inside).all(axis=1)
        if not free.any():
            return None
        cost = 0.25 * np.arange(len(middles), dtype=np.float64)
        for other, way in enumerate(self.ways):
            if other != index:
                on_it = (np.abs(way.along[:, None] - middles) < half + 0.03).all(axis=2)
                cost += 2.0 * on_it.any(axis=0)
        x, y = middles[int(np.argmin(np.where(free, cost, np.inf)))]
        return float(x - half[0]), float(y - half[1]), float(x + half[0]), float(y + half[1])

    def draw(self, axes: "Axes", note: str) -> None:
        """Draw on axes that are `size` inches wide and high, with a note below."""
        self._draw_arrows(axes)
        self._draw_states(axes)
        missing = sum(
            box is None and bool(arrow.label) for arrow, box in zip(self._arrows, self.labels, strict=True)
        )
        if missing:
            note += f" · {missing} number{'s' if missing > 1 else ''} without space, see the list"
        half = self.size / 2
        axes.set_xlim(-half, half)
        axes.set_ylim(-half, half)
        axes.axis("off")
        axes.text(-half, -half - 0.05, note, va="top", fontsize=9, color=SOFT)

    def _draw_arrows(self, axes: "Axes") -> None:
        from matplotlib.patches import FancyArrowPatch
        from matplotlib.path import Path

        for arrow, way, box in zip(self._arrows, self.ways, self.labels, strict=True):
            curve = Path.CURVE4 if len(way.path) == 4 else Path.CURVE3
            codes = [Path.MOVETO, *[curve] * (len(way.path) - 1)]
            color = SOFT if arrow.faint else state_color(self._first_color + arrow.source)
            axes.add_patch(
                FancyArrowPatch(
                    path=Path(way.path, codes), arrowstyle="-|>", mutation_scale=9 + 2.5 * arrow.width,
                    color=color, linewidth=arrow.width, alpha=0.3 if arrow.faint else 0.85, zorder=2,
                )
            )  # fmt: skip
            if box is None:
                continue
            axes.text(
                (box[0] + box[2]) / 2, (box[1] + box[3]) / 2, arrow.label, ha="center", va="center",
                color=INK, fontsize=_FONT_SIZE_POINTS, zorder=6, gid="label",
                bbox={"boxstyle": "round,pad=0.12", "facecolor": PAPER, "edgecolor": color, "linewidth": 0.7},
            )  # fmt: skip

    def _draw_states(self, axes: "Axes") -> None:
        from matplotlib.patches import Circle

        for index, (position, node) in enumerate(zip(self.positions, self._nodes, strict=True)):
            color = SOFT if node.faint else state_color(self._first_color + index)
            line = (4.0 if index == 0 else 2.0) if not node.faint else 1.4
            axes.add_patch(
                Circle(
                    position, self.radius, facecolor=PAPER, edgecolor=color, zorder=5, linewidth=line,
                    linestyle="--" if node.faint else "-",
                )
            )  # fmt: skip
            text: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 7, "parse_math": False}
            text["color"] = SOFT if node.faint else INK
            name = _wrap_name(node.name)
            up = 0.13 if name else 0.0
            axes.text(position[0], position[1] + up, str(index), fontsize=13, fontweight="bold", **text)
            if name:
                low = 0.13 + 0.04 * name.count("\n")
                axes.text(position[0], position[1] - low, name, fontsize=7.5, linespacing=1.05, **text)


def _width(label: str) -> float:
    """Return an upper bound of the width of a label's box."""
    return len(label) * _LETTER + 2 * _PAD


def _wrap_name(name: str) -> str:
    """Wrap a name into at most two lines that fit into a circle."""
    lines = textwrap.wrap(name, 12)
    if len(lines) > 2:
        lines = [lines[0], lines[1][:10] + "…"]
    return "\n".join(lines)


def position_of(index: int, states: int, ring: float) -> Point:
    """Return the position of a state on the circle, state 0 on top; a single state is in the middle."""
    angle = 2 * math.pi * index / states
    return ring * math.sin(angle), ring * math.cos(angle)


def _arc(source: Point, target: Point, bend: float, radius: float) -> _Way:
    """Return a route that bends to its right, by a share of its length."""
    (x0, y0), (x1, y1) = source, target
    middle = ((x0 + x1) / 2 + bend * (y1 - y0), (y0 + y1) / 2 - bend * (x1 - x0))
    path = (_towards(source, middle, radius), middle, _towards(target, middle, radius + 0.02))
    t = np.linspace(0, 1, _POINTS)[:, None]
    a, b, c = np.array(path)
    return _Way(path, (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)


def _towards(center: Point, target: Point, radius: float) -> Point:
    """Return the point on a state's border in the direction of another point."""
    share = radius / math.dist(center, target)
    return center[0] + share * (target[0] - center[0]), center[1] + share * (target[1] - center[1])


def _nearest(along: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    return float(np.hypot(*(along[:, None] - points).transpose(2, 0, 1)).min())
