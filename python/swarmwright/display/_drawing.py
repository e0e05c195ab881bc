"""Draws scenes with matplotlib: the map, bodies, and their trails."""

from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.display._episode import Recording
from swarmwright.display._ground import frame
from swarmwright.display._look import (
    BORDER,
    CELLS,
    FIELD,
    INK,
    MOVING,
    PAPER,
    Looks,
    agent_size,
    label,
    mixed,
)
from swarmwright.display._scene import Body, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from numpy.typing import NDArray
    from PIL.Image import Image

TRAIL_STEPS = 12
"""Length of a trail in an animation, in steps."""

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.42, 0.2, 0.45, 0.72
"""Inches: of the picture, and around the map for numbers, title and legend."""
STATUS = 2.6
"""Inches beside the title that step and fitness need."""
LONGEST_MESSAGE = 100
LEGEND_ROW, LEGEND_LETTER, LEGEND_MARK = 0.22, 0.088, 0.45
"""Inches of the legend: a row, a letter, a marker with its margin; about."""


class Picture:
    """A figure on which scene after scene of one recording is drawn.

    dpi: pixels an inch; a picture is 7 inches wide.
    """

    def __init__(self, recording: Recording, *, dpi: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._recording = recording
        self._size = _marker_area(recording.scenes[0])
        self._paths = _paths(recording.scenes)
        self._looks = Looks(recording.scenes)
        first = recording.scenes[0]
        # The map fills the width; the height follows, within limits.
        inside = (WIDTH - LEFT - RIGHT) * min(max(first.height / first.width, 0.25), 1.1)
        self._columns, rows = _legend_size(self._looks)
        bottom = BOTTOM + (rows - 1) * LEGEND_ROW
        height = inside + TOP + bottom
        self.figure = Figure(figsize=(WIDTH, height), dpi=dpi, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self.figure)
        box = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, inside / height)
        self._axes = self.figure.add_axes(box)
        frame(self._axes, first)
        self._title(first)
        self._legend()
        self._ground: Any = None  # what never changes, drawn once

    def image(self, scene: Scene, time: float) -> "Image":
        """The scene as an RGB image, trails fading behind. time: in steps."""
        from PIL import Image

        if self._ground is None:
            self._canvas.draw()  # type: ignore[no-untyped-call]
            self._ground = self._canvas.copy_from_bbox(self.figure.bbox)  # type: ignore[no-untyped-call]
        self._canvas.restore_region(self._ground)  # type: ignore[no-untyped-call]
        artists = self.draw(scene, time, trail=TRAIL_STEPS)
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
        text = f"step {scene.step} of {steps}   fitness {so_far:.3g}"
        artists: list[Artist] = [
            self._axes.text(
                1,
                1.0,
                text,
                transform=self._axes.transAxes,
                ha="right",
                va="bottom",
                fontsize=11,
                color=BORDER,
            )
        ]
        artists += self._trails(scene, time, trail)
        if trail is None:
            artists += self._beginnings()
        groups: dict[str, list[Body]] = {}
        for body in scene.bodies:
            groups.setdefault(label(body.kind, body.state), []).append(body)
        for bodies in groups.values():
            artists += self._group(bodies)
        return artists

    def _title(self, scene: Scene) -> None:
        # The message is plain text: a dollar sign in it does not begin a formula.
        message = " ".join(scene.message.split())[:LONGEST_MESSAGE]
        title = self._axes.text(
            0, 1.0, message, transform=self._axes.transAxes, ha="left", va="bottom", fontsize=13, color=INK,
            parse_math=False,
        )  # fmt: skip
        available = (WIDTH - LEFT - RIGHT - STATUS) * self.figure.dpi
        while title.get_window_extent(self._canvas.get_renderer()).width > available:  # type: ignore[no-untyped-call]
            message = message[:-1]
            title.set_text(f"{message.rstrip()}…")

    def _legend(self) -> None:
        """All labels of the recording, so that the legend does not change between frames."""
        from matplotlib.lines import Line2D

        seen = {
            label(body.kind, body.state): body for scene in self._recording.scenes for body in scene.bodies
        }
        handles = []
        for name, body in seen.items():
            color, marker, _, _ = self._looks.marker(body, self._size)
            size = 12 if marker == "*" else 9
            handles.append(
                Line2D(
                    [],
                    [],
                    color=color,
                    marker=marker,
                    linestyle="",
                    markersize=size,
                    markeredgecolor=PAPER,
                    label=name,
                )
            )
        self.figure.legend(
            handles=handles, loc="lower center", ncols=self._columns, frameon=False, fontsize=10,
            handletextpad=0.2, columnspacing=1.4, borderaxespad=0.2,
        )  # fmt: skip

    def _trails(self, scene: Scene, time: float, trail: int | None) -> "list[Artist]":
        from matplotlib.collections import LineCollection

        newest = int(time)
        oldest = 0 if trail is None else max(0, newest - trail)
        pieces: list[NDArray[np.float64]] = []
        colors: list[str] = []
        for index, way in self._paths.items():
            body = scene.bodies[index]
            passed = np.vstack([way[oldest : newest + 1], [[body.x, body.y]]])
            color = self._looks.color(body)
            shades = (
                np.full(len(passed) - 1, 0.65) if trail is None else np.linspace(0.1, 0.65, len(passed) - 1)
            )
            pieces.extend(np.stack([passed[:-1], passed[1:]], axis=1))
            # Opaque: where pieces overlap at their round ends, transparent ones would show dots.
            colors.extend(mixed(color, FIELD, float(shade)) for shade in shades)
        if not pieces:
            return []
        lines = LineCollection(pieces, colors=colors, linewidths=1.8, capstyle="round", zorder=2)
        return [self._axes.add_collection(lines)]

    def _beginnings(self) -> "list[Artist]":
        """Small rings where everything that moves came from."""
        if not self._paths:
            return []
        first = self._recording.scenes[0].bodies
        places = np.array([way[0] for way in self._paths.values()])
        colors = [self._looks.color(first[index]) for index in self._paths]
        size = min(max(6.0, self._size / 5), 20.0)
        return [
            self._axes.scatter(
                places[:, 0], places[:, 1], s=size, c=FIELD, edgecolors=colors, linewidths=1.0, zorder=2.2
            )
        ]

    def _group(self, bodies: list[Body]) -> "list[Artist]":
        from matplotlib.collections import EllipseCollection
        from matplotlib.colors import to_rgba

        axes = self._axes
        positions = np.array([(body.x, body.y) for body in bodies])
        diameters = np.array([2 * body.radius for body in bodies])
        color, marker, size, layer = self._looks.marker(bodies[0], self._size)
        if bodies[0].kind in CELLS:
            return [self._squares(positions, color, layer)]
        artists: list[Artist] = []
        if diameters.any():
            filled = 0.5 if bodies[0].kind == "obstacle" else 0.13
            discs = EllipseCollection(
                diameters, diameters, np.zeros(len(bodies)), units="xy", offsets=positions,
                offset_transform=axes.transData, facecolors=to_rgba(color, filled), edgecolors=color,
                linewidths=1.0, zorder=1.5,
            )  # fmt: skip
            artists.append(axes.add_collection(discs))
        points = axes.scatter(
            positions[:, 0], positions[:, 1], s=size, c=color, marker=marker, edgecolors=PAPER,
            linewidths=0.8, zorder=layer,
        )  # fmt: skip
        return [*artists, points]

    def _squares(self, middles: "NDArray[np.float64]", color: str, layer: float) -> "Artist":
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


def _legend_size(looks: Looks) -> tuple[int, int]:
    """Return columns and rows of a legend that fits below the map."""
    names = list(looks.plain())
    widest = max((len(name) for name in names), default=0) * LEGEND_LETTER + LEGEND_MARK
    columns = min(max(int(WIDTH / widest), 1), max(len(names), 1))
    return columns, max(-(-len(names) // columns), 1)


def _marker_area(scene: Scene) -> float:
    """Return the area of an agent's marker in points squared; in a grid it fills most of its cell."""
    if not scene.grid:
        return agent_size(scene)
    cell = 72 * (WIDTH - LEFT - RIGHT) / max(scene.width, scene.height)
    return min(max((0.6 * cell) ** 2, 3.0), 250.0)


def _paths(scenes: "Sequence[Scene]") -> "dict[int, NDArray[np.float64]]":
    """Positions over time, (scenes, 2), of every moving body; none when bodies appear or disappear."""
    first = scenes[0].bodies
    if any(len(scene.bodies) != len(first) for scene in scenes):
        return {}
    return {
        index: np.array(
            [(scene.bodies[index].x, scene.bodies[index].y) for scene in scenes], dtype=np.float64
        )
        for index, body in enumerate(first)
        if body.kind in MOVING
    }
