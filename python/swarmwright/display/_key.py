"""The legend of a picture: the meaning of shapes and colours."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.display._episode import Recording, Shown, fill_states
from swarmwright.display._look import (
    BORDER,
    FIELD,
    INK,
    LED,
    LINK_WIDTH,
    ORANGE,
    PAPER,
    RAY_WIDTH,
    STRETCH,
    Looks,
    floor_color,
    floor_labels,
    is_bright,
    label,
    to_hex,
    to_rgb,
    value_colors,
)
from swarmwright.display._scene import Bodies, Scale, Scene
from swarmwright.display.machines import state_color

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from numpy.typing import NDArray

Entry = tuple[str, tuple["Line2D", ...]]

_WIDTH = 7.0
_ROW, _LETTER, _MARK = 0.22, 0.088, 0.45
"""Approximate inches of a row, a letter, and a marker with its margin."""


class Key:
    """The legend of a recording, the same on all frames. more: additional inches beyond a first row.

    states: names of controller states that determine colours. kinds: names of kinds of agents. shown:
    optional parts of the picture. still: whether only the last scene is drawn, so that looks that do not
    occur there have no entry.
    """

    def __init__(
        self,
        recording: Recording,
        looks: Looks,
        size: float,
        *,
        valued: bool = True,
        states: Sequence[str] = (),
        kinds: Sequence[str] = (),
        shown: Shown | None = None,
        still: bool = False,
    ) -> None:
        self._shown = shown or Shown()
        self._scenes = recording.scenes[-1:] if still else recording.scenes
        self.scale = scale_of(recording) if valued else None
        self._states = states
        self._kinds = kinds
        self.entries = self._build_entries(recording, looks, size)
        """Label and stacked symbols of each entry."""
        count = len(self.entries)
        widths = [len(name) * _LETTER + _MARK for name, _ in self.entries]
        self._columns = next(
            (columns for columns in range(count, 1, -1) if _fits(widths, columns)),
            1,
        )
        rows = max(-(-count // self._columns), 1)
        self._bar = 0.5 if self.scale is not None else 0.0
        self.more = (rows - 1) * _ROW + self._bar

    def shares(self, values: "NDArray[np.float32]") -> "NDArray[np.float64]":
        """Return relative positions of values in their range, 0..1."""
        assert self.scale is not None
        low, high = self.scale.low, self.scale.high
        return (values.astype(np.float64) - low) / max(high - low, 1e-30)

    def draw(self, figure: "Figure") -> None:
        """Draw the legend below the map."""
        from matplotlib.legend_handler import HandlerTuple

        handles: list[Any] = [symbols for _, symbols in self.entries]
        figure.legend(
            handles, [name for name, _ in self.entries],
            handler_map={tuple: HandlerTuple(ndivide=1)}, loc="lower center", ncols=self._columns,
            frameon=False, fontsize=10, handletextpad=0.2, columnspacing=1.4, borderaxespad=0.2,
            bbox_to_anchor=(0.5, self._bar / figure.get_figheight()),
        )  # fmt: skip
        if self.scale is not None:
            self._gradient(figure, self.scale)

    def _gradient(self, figure: "Figure", scale: Scale) -> None:
        height = figure.get_figheight()
        axes = figure.add_axes((0.5 - 0.9 / _WIDTH, 0.2 / height, 1.8 / _WIDTH, 0.12 / height))
        ramp = value_colors(np.linspace(0, 1, 24))[None]
        axes.imshow(ramp, aspect="auto", extent=(0, 1, 0, 1), interpolation="nearest")
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_color(BORDER)
        text: dict[str, Any] = {"va": "center", "fontsize": 10, "color": INK, "parse_math": False}
        name = " ".join(scale.name.split())[:30]
        axes.text(-0.04, 0.5, f"{name}   {scale.low:.3g}" if name else f"{scale.low:.3g}", ha="right", **text)
        axes.text(1.04, 0.5, f"{scale.high:.3g}", ha="left", **text)

    def _build_entries(self, recording: Recording, looks: Looks, size: float) -> list[Entry]:
        entries = self._body_entries(recording, looks, size)
        floor_colors: dict[str, str] = {}
        walls = lights = False
        for scene in self._scenes:
            for grey, name in floor_labels(scene).items():
                floor_colors.setdefault(name, floor_color(grey))
            walls |= len(scene.walls) > 0
            lights |= len(scene.lights) > 0
        entries += [(name, (_mark(color, "s", edge=BORDER),)) for name, color in floor_colors.items()]
        if walls:
            entries.append(("wall", (_mark(BORDER, "s", edge=BORDER),)))
        if lights:
            entries.append(("lamp", (_mark(ORANGE, "o", 8, edge=BORDER),)))
        return entries + self._lines(looks)

    def _lines(self, looks: Looks) -> list[Entry]:
        """Return the entries of thin lines."""
        scenes = [(Bodies.from_bodies(scene.bodies), scene) for scene in self._scenes]
        entries: list[Entry] = []
        owners = ((bodies, bodies.ray_body[0]) for bodies, _ in scenes if len(bodies.ray_body))
        owner = next(owners, None)
        if self._shown.rays and owner is not None:
            entries.append(("sensor ray", (_dash(self._color(looks, *owner), RAY_WIDTH),)))
        if self._shown.links and any(len(scene.links) for _, scene in scenes):
            entries.append(("message heard", (_dash(BORDER, LINK_WIDTH),)))
        return entries

    def _color(self, looks: Looks, bodies: Bodies, body: int) -> str:
        """Return a colour of a body, which its rays share."""
        if self._states:
            return state_color(0)
        value = bodies.value[body]
        if self.scale is None or np.isnan(value):
            return looks.color(bodies.looks[bodies.look[body]])
        return to_hex(value_colors(self.shares(bodies.value[[body]]))[0])

    def _body_entries(self, recording: Recording, looks: Looks, size: float) -> list[Entry]:
        other_colored = _find_valued(recording) if self.scale is not None else set()
        if self._states:
            other_colored = {
                look for scene in recording.scenes for look in _find_state_colored(recording, scene)
            }
        headed = find_directed(recording)
        entries: list[Entry] = []
        # By symbol: looks whose colours mean something else differ by shape only.
        alike: dict[tuple[str, bool], list[tuple[str, str]]] = {}
        drawn = self._find_looks()
        for look in looks.names():
            if look == (LED, "") or look not in drawn:
                continue
            color, marker, _, _ = looks.marker(look, size)
            symbol = ("o", True) if look in headed else (marker, False)
            if look not in other_colored:
                entries.append((label(*look, self._kinds), _symbol(color, *symbol)))
                continue
            alike.setdefault(symbol, []).append(look)
        entries = [
            (self._join_labels(same), _symbol(FIELD, *symbol, edge=INK)) for symbol, same in alike.items()
        ] + entries
        return entries + [
            (name, (_mark(state_color(index), "o"),)) for index, name in enumerate(self._states)
        ]

    def _find_looks(self) -> set[tuple[str, str]]:
        """Return the kinds and states of bodies in the drawn scenes."""
        every = [Bodies.from_bodies(scene.bodies) for scene in self._scenes]
        return {bodies.looks[index] for bodies in every for index in np.unique(bodies.look)}

    def _join_labels(self, alike: list[tuple[str, str]]) -> str:
        """Return a common label for looks that share a symbol."""
        if len(alike) == 1:
            return label(*alike[0], self._kinds)
        return ", ".join(dict.fromkeys(kind for kind, _ in alike))


def _mark(color: str, marker: Any, size: float = 9, *, edge: str = PAPER) -> "Line2D":  # noqa: ANN401 - as in matplotlib
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, marker=marker, linestyle="", markersize=size, markeredgecolor=edge)


def _dash(color: str, width: float) -> "Line2D":
    """Return a symbol for thin lines, as wide as other symbols, so that texts are aligned."""
    from matplotlib.path import Path

    line = _mark(color, Path([(-1, 0), (1, 0)]), 14, edge=color)
    line.set_markeredgewidth(width)
    return line


def _symbol(color: str, marker: str, is_directed: bool, *, edge: str = PAPER) -> "tuple[Line2D, ...]":
    """Return the symbols of a body, including its heading line."""
    body = _mark(color, marker, 12 if marker == "*" else 9, edge=edge)
    if not is_directed:
        return (body,)
    from matplotlib.path import Path

    line = _mark(
        color, Path([(0, 0), (1, 0)]), edge=INK if is_bright(np.array(to_rgb(color)) / 255) else PAPER
    )
    line.set_markeredgewidth(1.6)
    return body, line


def _fits(widths: list[float], columns: int) -> bool:
    """Whether entries of these widths fit into a number of columns, filled column by column."""
    # Distributed as in matplotlib.
    return sum(float(max(part)) for part in np.array_split(widths, columns)) <= _WIDTH


def scale_of(recording: Recording) -> Scale | None:
    """Return the range of the bodies' values: that of the scenes, or from the smallest to the largest."""
    declared = next((scene.scale for scene in recording.scenes if scene.scale is not None), None)
    values = np.concatenate([Bodies.from_bodies(scene.bodies).value for scene in recording.scenes])
    values = values[~np.isnan(values)]
    if not len(values):
        return None
    if declared is not None:
        return declared
    low, high = float(values.min()), float(values.max())
    return Scale("value", low, high if high > low else low + 1.0)


def find_directed(recording: Recording) -> set[tuple[str, str]]:
    """Return the kinds and states whose bodies have headings and are drawn as discs."""
    looks: set[tuple[str, str]] = set()
    for scene in recording.scenes:
        bodies = Bodies.from_bodies(scene.bodies)
        if looks.issuperset(bodies.looks):
            continue
        headed = bodies.look[~np.isnan(bodies.heading)]
        looks |= {bodies.looks[index] for index in np.flatnonzero(np.bincount(headed))}
    return {look for look in looks if look[0] not in {LED, STRETCH}}


def _find_valued(recording: Recording) -> set[tuple[str, str]]:
    """Return the kinds and states whose bodies are coloured by value."""
    looks: set[tuple[str, str]] = set()
    for scene in recording.scenes:
        bodies = Bodies.from_bodies(scene.bodies)
        looks |= {bodies.looks[index] for index in np.unique(bodies.look[~np.isnan(bodies.value)])}
    return looks


def _find_state_colored(recording: Recording, scene: Scene) -> set[tuple[str, str]]:
    """Return the kinds and states of agents that are coloured by controller state."""
    assert recording.trace is not None
    assert recording.trace.states is not None
    bodies = Bodies.from_bodies(scene.bodies)
    states = fill_states(recording.trace.states[-1], int(bodies.agents().max(initial=-1)) + 1)
    agents = bodies.agents()
    with_states = agents >= 0
    with_states[with_states] = states[agents[with_states]] >= 0
    return {bodies.looks[index] for index in np.unique(bodies.look[with_states])}
