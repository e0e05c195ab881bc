"""Draws scenes with matplotlib: the map, bodies, and their trails."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.plain_figures import plain
from swarmwright.display import _robots
from swarmwright.display._bodies import Bodies
from swarmwright.display._episode import Recording
from swarmwright.display._ground import frame, ground_of, lay
from swarmwright.display._key import Key, scale_of
from swarmwright.display._labels import Labels
from swarmwright.display._look import (
    BORDER,
    CELLS,
    FIELD,
    INK,
    LED,
    PAPER,
    STATES,
    STRETCH,
    Looks,
    agent_size,
    moving,
    rgb,
    value_colors,
)
from swarmwright.display._machine import StateColors
from swarmwright.display._part import Part
from swarmwright.display._scene import Scene
from swarmwright.display._shown import Shown
from swarmwright.display.state_colors import state_color

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from numpy.typing import NDArray
    from PIL.Image import Image

TRAIL_STEPS = 12
"""Length of a trail in an animation, in steps."""
LONG_TRAIL_STEPS, LONG = 60, 300
"""The same in episodes of more steps than this, where steps are short."""
MOST_TRAILS = 1000
"""With more moving bodies there are no trails: they would hide everything."""
MOST_POINTS = 400
"""Points of the trail of a whole episode."""

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.42, 0.2, 0.45, 0.72
"""Inches: of the picture, and around the map for numbers, title and legend."""
STATUS, SECONDS = 2.6, 0.7
"""Inches beside the title that step and fitness need, and seconds."""
LONGEST_MESSAGE = 100


class Picture:
    """A figure on which scene after scene of one recording is drawn.

    shows: the recording, or with what is known of its controller. dpi: pixels an inch; a picture is 7 inches
    wide. shown: what is drawn of it. still: whether the last scene is drawn alone.
    """

    @plain()
    def __init__(
        self, shows: Recording | Part, *, dpi: int, shown: Shown | None = None, still: bool = False
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        part = Part.of(shows)
        recording = self._recording = part.recording
        self._seconds = part.step_seconds
        self._shown = shown or Shown()
        first = recording.scenes[0]
        self._size = _marker_area(first)
        self._looks = Looks(recording.scenes)
        self._colors = {look: np.array(rgb(self._looks.color(look))) / 255 for look in self._looks.all()}
        states = None if recording.trace is None else recording.trace.states
        self._states = states if self._shown.colors == "controller" else None
        self._valued = self._states is None and self._shown.colors != "state"
        self._state_colors: StateColors | None = None
        if self._states is not None:
            self._state_colors = StateColors.of(part.controller, self._states, Bodies.of(first.bodies))
        self._changing = self._states is not None or (self._valued and scale_of(recording) is not None)
        names = self._state_colors.labels if self._state_colors is not None else ()
        self.states = len(names)
        """How many states of controllers give bodies their colours."""
        self._key = Key(
            recording,
            self._looks,
            self._size,
            valued=self._valued,
            states=names,
            kinds=part.kind_names,
            shown=self._shown,
            still=still,
        )
        # The map fills the width; the height follows, within limits.
        inside = (WIDTH - LEFT - RIGHT) * min(max(first.height / first.width, 0.25), 1.1)
        bottom = BOTTOM + self._key.more
        height = inside + TOP + bottom
        self.figure = Figure(figsize=(WIDTH, height), dpi=dpi, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self.figure)
        box = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, inside / height)
        self._axes = self.figure.add_axes(box)
        self._field = frame(self._axes, first)
        # Points of a picture for each metre or cell.
        self._scale = 72 * min((WIDTH - LEFT - RIGHT) / first.width, inside / first.height) / 1.024
        ground = ground_of(first)
        self._still = all(ground_of(scene) == ground for scene in recording.scenes)
        if self._still:
            lay(self._axes, first)
        self._paths = _paths(recording.scenes) if self._shown.trails else {}
        self._passed: dict[int, NDArray[np.float64]] = {}
        self._labels = Labels(self._scale, least=math.sqrt(self._size) / 2)
        self._title(first)
        self._key.draw(self.figure)
        self._ground: Any = None  # what never changes, drawn once

    @plain()
    def image(self, scene: Scene, time: float) -> "Image":
        """The scene as an RGB image, trails fading behind. time: in steps."""
        from PIL import Image

        if self._ground is None:
            self._canvas.draw()  # type: ignore[no-untyped-call]
            self._ground = self._canvas.copy_from_bbox(self.figure.bbox)  # type: ignore[no-untyped-call]
        self._canvas.restore_region(self._ground)  # type: ignore[no-untyped-call]
        steps = LONG_TRAIL_STEPS if len(self._recording.scenes) > LONG else TRAIL_STEPS
        artists = self.draw(scene, time, trail=steps)
        for artist in sorted(artists, key=lambda a: a.get_zorder()):
            self.figure.draw_artist(artist)
        pixels = np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[no-untyped-call]
        for artist in artists:
            artist.remove()
        return Image.fromarray(pixels)

    def draw(self, scene: Scene, time: float, *, trail: int | None = None) -> "list[Artist]":
        """Put a scene on the figure; what was put there.

        time: in steps, between two scenes when it is a fraction.
        trail: length of trails in steps; None: all the way.
        """
        steps = len(self._recording.scenes) - 1
        so_far = self._recording.fitness_so_far[min(int(time), steps)] + 0.0  # no -0
        seconds = "" if self._seconds is None else f", {scene.step * self._seconds:.4g} s"
        text = f"step {scene.step} of {steps}{seconds}   fitness {so_far:.4g}"
        artists: list[Artist] = [
            self._axes.text(
                1, 1.0, text, transform=self._axes.transAxes, ha="right", va="bottom", fontsize=11,
                color=BORDER,
            )
        ]  # fmt: skip
        if not self._still:
            artists += lay(self._axes, scene)
        bodies = Bodies.of(scene.bodies)
        colors = self._colors_of(bodies, int(time))
        artists += self._trails(bodies, colors, time, trail)
        if trail is None:
            artists += self._beginnings()
        if self._shown.rays:
            artists += _robots.rays(self._axes, bodies, colors)
        if self._shown.links and len(scene.links):
            artists += _robots.links(self._axes, bodies, np.asarray(scene.links))
        directed = ~np.isnan(bodies.heading)
        for index, look in enumerate(bodies.looks):
            of_look = bodies.look == index
            if look[0] == LED:
                if look[1] and of_look.any():
                    artists += _robots.leds(self._axes, bodies, of_look, self._colors[look])
                continue
            if look[0] == STRETCH and (of_look & directed).any():
                artists += _robots.stretches(self._axes, bodies, of_look & directed, colors)
                of_look &= ~directed
            if of_look[~directed].any():
                artists += self._group(bodies, of_look & ~directed, look, colors)
            if of_look[directed].any():
                chosen = of_look & directed
                valued = self._valued and not np.isnan(bodies.value[chosen]).all()
                artists += _robots.robots(
                    self._axes, bodies, chosen, colors[chosen], self._scale, valued=valued
                )
        if self._shown.labels is not False and bodies.labels:
            artists += self._labels.draw(self._axes, bodies)
        return artists

    def _colors_of(self, bodies: Bodies, time: int) -> "NDArray[np.float64]":
        """Colours of all bodies, (bodies, 3): of kind and state, value, or the controller's state."""
        by_look = np.array([self._colors[look] for look in bodies.looks]).reshape(-1, 3)
        colors = by_look[bodies.look]
        valued = ~np.isnan(bodies.value)
        if self._valued and valued.any():
            colors[valued] = value_colors(self._key.shares(bodies.value[valued]))
        if self._states is not None and self._state_colors is not None:
            agents = bodies.agents()
            known = np.flatnonzero((agents >= 0) & (agents < self._states.shape[1]))
            now = self._states[min(time, len(self._states) - 1), agents[known]]
            known, now = known[now >= 0], now[now >= 0]
            now = now + self._state_colors.first[agents[known]]
            colors[known] = (
                np.array([rgb(state_color(state)) for state in range(len(STATES))])[now % len(STATES)] / 255
            )
        return colors

    def _title(self, scene: Scene) -> None:
        # The message is plain text: a dollar sign in it does not begin a formula.
        message = " ".join(scene.message.split())[:LONGEST_MESSAGE]
        title = self._axes.text(
            0, 1.0, message, transform=self._axes.transAxes, ha="left", va="bottom", fontsize=13, color=INK,
            parse_math=False,
        )  # fmt: skip
        status = STATUS + (SECONDS if self._seconds is not None else 0.0)
        available = (WIDTH - LEFT - RIGHT - status) * self.figure.dpi
        while title.get_window_extent(self._canvas.get_renderer()).width > available:  # type: ignore[no-untyped-call]
            message = message[:-1]
            title.set_text(f"{message.rstrip()}…")

    def _trails(
        self, bodies: Bodies, colors: "NDArray[np.float64]", time: float, trail: int | None
    ) -> "list[Artist]":
        from matplotlib.collections import LineCollection

        newest = int(time)
        oldest = 0 if trail is None else max(0, newest - trail)
        stride = 1 if trail is not None else -(-(newest + 1) // MOST_POINTS)
        pieces: list[NDArray[np.float64]] = []
        shades: list[NDArray[np.float64]] = []
        ground = np.array(rgb(FIELD)) / 255
        # Colours of kind and state are those of now. Others change on the way, and each piece has its own.
        steps = range(oldest, newest + 1, stride) if self._changing else ()
        past = np.array([self._passed_colors(step) for step in steps])
        for place, (index, way) in enumerate(self._paths.items()):
            passed = np.vstack([way[oldest : newest + 1 : stride], [[bodies.x[index], bodies.y[index]]]])
            count = len(passed) - 1
            share = np.full(count, 0.65) if trail is None else np.linspace(0.1, 0.65, count)
            pieces.extend(np.stack([passed[:-1], passed[1:]], axis=1))
            color = past[:, place] if self._changing else colors[index]
            # Opaque: where pieces overlap at their round ends, transparent ones would show dots.
            shades.append(share[:, None] * color + (1 - share[:, None]) * ground)
        if not pieces:
            return []
        # Robots that run for minutes would cover the floor.
        width = 1.8 if len(self._paths) * newest < 4000 or trail is not None else 0.7
        lines = LineCollection(
            pieces,
            colors=np.round(np.vstack(shades) * 255) / 255,
            linewidths=width,
            capstyle="round",
            zorder=1.2,
        )
        self._axes.add_collection(lines)
        lines.set_clip_path(self._field)
        return [lines]

    def _passed_colors(self, step: int) -> "NDArray[np.float64]":
        """Colours that everything that leaves a trail had at a step, (trails, 3)."""
        if step not in self._passed:
            bodies = Bodies.of(self._recording.scenes[step].bodies)
            self._passed[step] = self._colors_of(bodies, step)[list(self._paths)]
        return self._passed[step]

    def _beginnings(self) -> "list[Artist]":
        """Small rings where everything that moves came from."""
        if not self._paths:
            return []
        first = Bodies.of(self._recording.scenes[0].bodies)
        places = np.array([way[0] for way in self._paths.values()])
        colors = self._colors_of(first, 0)[list(self._paths)]
        size = min(max(6.0, self._size / 5), 20.0)
        return [
            self._axes.scatter(
                places[:, 0],
                places[:, 1],
                s=size,
                c=FIELD,
                edgecolors=colors.tolist(),
                linewidths=1.0,
                zorder=1.3,
            )
        ]

    def _group(
        self,
        bodies: Bodies,
        chosen: "NDArray[np.bool_]",
        look: tuple[str, str],
        colors: "NDArray[np.float64]",
    ) -> "list[Artist]":
        """Draw bodies of one kind and state without a heading."""
        from matplotlib.collections import EllipseCollection

        axes = self._axes
        positions = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1)
        diameters = 2 * bodies.radius[chosen]
        color, marker, size, layer = self._looks.marker(look, self._size)
        if look[0] in CELLS:
            return [self._squares(positions, color, layer)]
        artists: list[Artist] = []
        if diameters.any():
            filled = 0.5 if look[0] == "obstacle" else 0.13
            faces = np.column_stack([colors[chosen], np.full(len(diameters), filled)])
            discs = EllipseCollection(
                diameters, diameters, np.zeros(len(diameters)), units="xy", offsets=positions,
                offset_transform=axes.transData, facecolors=faces, edgecolors=colors[chosen],
                linewidths=1.0, zorder=1.5,
            )  # fmt: skip
            artists.append(axes.add_collection(discs))
        points = axes.scatter(
            positions[:, 0], positions[:, 1], s=size, c=colors[chosen], marker=marker, edgecolors=PAPER,
            linewidths=0.8, zorder=layer,
        )  # fmt: skip
        return [*artists, points]

    def _squares(self, middles: "NDArray[np.float32]", color: str, layer: float) -> "Artist":
        from matplotlib.collections import PolyCollection

        corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
        squares = PolyCollection(
            list(middles[:, None, :] + corners),
            facecolors=color,
            edgecolors=FIELD,
            linewidths=0.6,
            zorder=layer,
        )
        return self._axes.add_collection(squares)


def _marker_area(scene: Scene) -> float:
    """Return the area of an agent's marker in points squared; in a grid it fills most of its cell."""
    if not scene.grid:
        return agent_size(scene)
    cell = 72 * (WIDTH - LEFT - RIGHT) / max(scene.width, scene.height)
    return min(max((0.6 * cell) ** 2, 3.0), 250.0)


def _paths(scenes: "Sequence[Scene]") -> "dict[int, NDArray[np.float64]]":
    """Positions over time, (scenes, 2), of every moving body; none when bodies appear or disappear."""
    every = [Bodies.of(scene.bodies) for scene in scenes]
    first = every[0]
    ways = np.flatnonzero(moving(first))
    if len(ways) > MOST_TRAILS or any(len(bodies) != len(first) for bodies in every):
        return {}
    xs = np.array([bodies.x[ways] for bodies in every], dtype=np.float64)
    ys = np.array([bodies.y[ways] for bodies in every], dtype=np.float64)
    return {int(body): np.stack([xs[:, k], ys[:, k]], axis=1) for k, body in enumerate(ways)}
