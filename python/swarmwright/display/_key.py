"""The legend of a picture: what shapes and colours mean."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.display._bodies import Bodies
from swarmwright.display._episode import Recording, Shown
from swarmwright.display._look import (
    BORDER,
    FIELD,
    INK,
    LED,
    ORANGE,
    PAPER,
    STRETCH,
    Looks,
    floor_color,
    floors,
    hexadecimal,
    is_bright,
    label,
    rgb,
    value_colors,
)
from swarmwright.display._robots import LINK_WIDTH, RAY_WIDTH
from swarmwright.display._scene import Scale, Scene
from swarmwright.display._trace import states_of
from swarmwright.display.state_colors import state_color

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from numpy.typing import NDArray

Entry = tuple[str, tuple["Line2D", ...]]

_WIDTH = 7.0
_ROW, _LETTER, _MARK = 0.22, 0.088, 0.45
"""Inches of the legend: a row, a letter, a marker with its margin; about."""


class Key:
    """The legend of a recording: the same on all frames. more: inches that it needs beside a first row.

    states: what the states of controllers are called that give bodies their colours. kinds: names of kinds of
    agents. shown: what is drawn of the recording. still: whether the last scene alone is drawn, so that what
    no body is in there has no entry.
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
        self.entries = self._made(recording, looks, size)
        """Label and what is drawn beside it, one thing upon the other, of each entry."""
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
        """Return where values lie in their range, 0..1."""
        assert self.scale is not None
        low, high = self.scale.low, self.scale.high
        return (values.astype(np.float64) - low) / max(high - low, 1e-30)

    def draw(self, figure: "Figure") -> None:
        """Put the legend below the map."""
        from matplotlib.legend_handler import HandlerTuple

        handles: list[Any] = [drawn for _, drawn in self.entries]
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

    def _made(self, recording: Recording, looks: Looks, size: float) -> list[Entry]:
        made = self._of_bodies(recording, looks, size)
        seen: dict[str, str] = {}
        walls = lights = False
        for scene in self._scenes:
            for grey, name in floors(scene).items():
                seen.setdefault(name, floor_color(grey))
            walls |= len(scene.walls) > 0
            lights |= len(scene.lights) > 0
        made += [(name, (_mark(color, "s", edge=BORDER),)) for name, color in seen.items()]
        if walls:
            made.append(("wall", (_mark(BORDER, "s", edge=BORDER),)))
        if lights:
            made.append(("lamp", (_mark(ORANGE, "o", 8, edge=BORDER),)))
        return made + self._lines(looks)

    def _lines(self, looks: Looks) -> list[Entry]:
        """Return the entries of what is drawn as thin lines."""
        every = [(Bodies.of(scene.bodies), scene) for scene in self._scenes]
        made: list[Entry] = []
        owners = ((bodies, bodies.ray_body[0]) for bodies, _ in every if len(bodies.ray_body))
        owner = next(owners, None)
        if self._shown.rays and owner is not None:
            made.append(("sensor ray", (_dash(self._color(looks, *owner), RAY_WIDTH),)))
        if self._shown.links and any(len(scene.links) for _, scene in every):
            made.append(("message heard", (_dash(BORDER, LINK_WIDTH),)))
        return made

    def _color(self, looks: Looks, bodies: Bodies, body: int) -> str:
        """Return a colour that a body can have, whose rays have it too."""
        if self._states:
            return state_color(0)
        value = bodies.value[body]
        if self.scale is None or np.isnan(value):
            return looks.color(bodies.looks[bodies.look[body]])
        return hexadecimal(value_colors(self.shares(bodies.value[[body]]))[0])

    def _of_bodies(self, recording: Recording, looks: Looks, size: float) -> list[Entry]:
        others = _valued(recording) if self.scale is not None else set()
        if self._states:
            others = {look for scene in recording.scenes for look in _looks_with_states(recording, scene)}
        headed = directed(recording)
        made: list[Entry] = []
        # By symbol: those whose colours mean something else are told apart by their shape alone.
        alike: dict[tuple[str, bool], list[tuple[str, str]]] = {}
        drawn = self._looks()
        for look in looks.all():
            if look == (LED, "") or look not in drawn:
                continue
            color, marker, _, _ = looks.marker(look, size)
            symbol = ("o", True) if look in headed else (marker, False)
            if look not in others:
                made.append((label(*look, self._kinds), _symbol(color, *symbol)))
                continue
            alike.setdefault(symbol, []).append(look)
        made = [
            (self._common(same), _symbol(FIELD, *symbol, edge=INK)) for symbol, same in alike.items()
        ] + made
        return made + [(name, (_mark(state_color(index), "o"),)) for index, name in enumerate(self._states)]

    def _looks(self) -> set[tuple[str, str]]:
        """Return the kinds and states that bodies have in what is drawn."""
        every = [Bodies.of(scene.bodies) for scene in self._scenes]
        return {bodies.looks[index] for bodies in every for index in np.unique(bodies.look)}

    def _common(self, alike: list[tuple[str, str]]) -> str:
        """Return what bodies are called that look alike because their colours mean something else."""
        if len(alike) == 1:
            return label(*alike[0], self._kinds)
        return ", ".join(dict.fromkeys(kind for kind, _ in alike))


def _mark(color: str, marker: Any, size: float = 9, *, edge: str = PAPER) -> "Line2D":  # noqa: ANN401 - as matplotlib takes it
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, marker=marker, linestyle="", markersize=size, markeredgecolor=edge)


def _dash(color: str, width: float) -> "Line2D":
    """Return what stands for thin lines: as wide as other symbols, so that texts begin at one place."""
    from matplotlib.path import Path

    line = _mark(color, Path([(-1, 0), (1, 0)]), 14, edge=color)
    line.set_markeredgewidth(width)
    return line


def _symbol(color: str, marker: str, directed: bool, *, edge: str = PAPER) -> "tuple[Line2D, ...]":
    """Return what stands for a body: with a heading the line to where it looks."""
    body = _mark(color, marker, 12 if marker == "*" else 9, edge=edge)
    if not directed:
        return (body,)
    from matplotlib.path import Path

    line = _mark(color, Path([(0, 0), (1, 0)]), edge=INK if is_bright(np.array(rgb(color)) / 255) else PAPER)
    line.set_markeredgewidth(1.6)
    return body, line


def _fits(widths: list[float], columns: int) -> bool:
    """Return whether a legend of entries so wide has space for them in columns, which it fills one by one."""
    # As matplotlib shares them out.
    return sum(float(max(part)) for part in np.array_split(widths, columns)) <= _WIDTH


def scale_of(recording: Recording) -> Scale | None:
    """Return the range of the values of bodies, what the scenes say or from the least to the greatest."""
    said = next((scene.scale for scene in recording.scenes if scene.scale is not None), None)
    every = [Bodies.of(scene.bodies).value for scene in recording.scenes]
    values = np.concatenate([value[~np.isnan(value)] for value in every])
    if not len(values):
        return None
    if said is not None:
        return said
    low, high = float(values.min()), float(values.max())
    return Scale("value", low, high if high > low else low + 1.0)


def directed(recording: Recording) -> set[tuple[str, str]]:
    """Return the kinds and states whose bodies have headings: discs, whatever their shape is without one."""
    found: set[tuple[str, str]] = set()
    for scene in recording.scenes:
        bodies = Bodies.of(scene.bodies)
        found |= {bodies.looks[index] for index in np.unique(bodies.look[~np.isnan(bodies.heading)])}
    return {look for look in found if look[0] not in {LED, STRETCH}}


def _valued(recording: Recording) -> set[tuple[str, str]]:
    """Return the kinds and states whose bodies have values, which give them their colours."""
    found: set[tuple[str, str]] = set()
    for scene in recording.scenes:
        bodies = Bodies.of(scene.bodies)
        found |= {bodies.looks[index] for index in np.unique(bodies.look[~np.isnan(bodies.value)])}
    return found


def _looks_with_states(recording: Recording, scene: Scene) -> set[tuple[str, str]]:
    """Return the kinds and states of agents whose controllers have states, which give them their colours."""
    assert recording.trace is not None
    assert recording.trace.states is not None
    bodies = Bodies.of(scene.bodies)
    states = states_of(recording.trace.states[-1], int(bodies.agents().max(initial=-1)) + 1)
    agents = bodies.agents()
    with_states = agents >= 0
    with_states[with_states] = states[agents[with_states]] >= 0
    return {bodies.looks[index] for index in np.unique(bodies.look[with_states])}
