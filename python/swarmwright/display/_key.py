"""The legend of a picture: what shapes and colours mean."""

from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.core.state_colors import state_color
from swarmwright.display._bodies import Bodies
from swarmwright.display._episode import Recording
from swarmwright.display._look import (
    BORDER,
    FIELD,
    INK,
    LED,
    ORANGE,
    PAPER,
    Looks,
    floor_color,
    floors,
    label,
    value_colors,
)
from swarmwright.display._scene import Scale, Scene
from swarmwright.display._trace import states_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

_WIDTH = 7.0
_ROW, _LETTER, _MARK = 0.22, 0.088, 0.45
"""Inches of the legend: a row, a letter, a marker with its margin; about."""


class Key:
    """The legend of a recording: the same on all frames. more: inches that it needs beside a first row."""

    def __init__(
        self,
        recording: Recording,
        looks: Looks,
        size: float,
        *,
        valued: bool = True,
        states: list[str] | None = None,
    ) -> None:
        self.scale = scale_of(recording) if valued else None
        self._states = states or []
        self._handles = self._made(recording, looks, size)
        count = len(self._handles)
        widths = [len(handle.get_label()) * _LETTER + _MARK for handle in self._handles]
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
        figure.legend(
            handles=self._handles, loc="lower center", ncols=self._columns, frameon=False, fontsize=10,
            handletextpad=0.2, columnspacing=1.4, borderaxespad=0.2,
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

    def _made(self, recording: Recording, looks: Looks, size: float) -> list[Any]:
        from matplotlib.lines import Line2D

        def mark(name: str, color: str, marker: str, large: float, edge: str = PAPER) -> Line2D:
            return Line2D(
                [], [], color=color, marker=marker, linestyle="", markersize=large, markeredgecolor=edge,
                label=name,
            )  # fmt: skip

        handles: list[Any] = []
        others = _valued(recording) if self.scale is not None else set()
        if self._states:
            others = {look for scene in recording.scenes for look in _looks_with_states(recording, scene)}
        for look in looks.all():
            if look == (LED, ""):
                continue
            if look in others:
                handles.append(mark(label(*look), FIELD, "o", 9, INK))
                continue
            color, marker, _, _ = looks.marker(look, size)
            handles.append(mark(label(*look), color, marker, 12 if marker == "*" else 9))
        for index, name in enumerate(self._states):
            handles.append(mark(name, state_color(index), "o", 9))
        seen: dict[str, str] = {}
        walls = lights = False
        for scene in recording.scenes:
            for grey, name in floors(scene).items():
                seen.setdefault(name, floor_color(grey))
            walls |= len(scene.walls) > 0
            lights |= len(scene.lights) > 0
        for name, color in seen.items():
            handles.append(mark(name, color, "s", 9, BORDER))
        if walls:
            handles.append(mark("wall", BORDER, "s", 9, BORDER))
        if lights:
            handles.append(mark("light", ORANGE, "o", 8, BORDER))
        return handles


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
