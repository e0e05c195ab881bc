"""Drawing of scenes with matplotlib: map, grid, bodies, trails, labels."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarmwright.common.plain_figures import use_plain_settings
from swarmwright.display._episode import Part, Recording, Shown
from swarmwright.display._key import Key, scale_of
from swarmwright.display._look import (
    BORDER,
    CELLS,
    FIELD,
    GRID,
    HALO_SHARE,
    HALO_WIDTH,
    INK,
    LED,
    LINK_WIDTH,
    ORANGE,
    PAPER,
    RAY_WIDTH,
    STATES,
    STRETCH,
    Looks,
    agent_size,
    floor_color,
    floor_patch,
    is_bright,
    is_moving,
    marker_area,
    mix,
    to_rgb,
    value_colors,
)
from swarmwright.display._scene import Bodies, Patch, Scene
from swarmwright.display.machines import StateColors, state_color

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch as Drawn
    from matplotlib.patches import Rectangle
    from numpy.typing import NDArray
    from PIL.Image import Image

_SMALLEST_RADIUS_POINTS = 1.3
"""Smallest drawn radius in points, so that bodies are visible."""
_HEADING_RADIUS_POINTS = 2.2
"""Smallest radius in points at which a heading line is drawn."""


def draw_robots(
    axes: "Axes",
    bodies: Bodies,
    chosen: "NDArray[np.bool_]",
    colors: "NDArray[np.float64]",
    scale: float,
    *,
    valued: bool,
) -> "list[Artist]":
    """Draw discs with a heading line; bodies without a radius are as large as markers.

    chosen: (bodies,), which bodies. colors: their colours, (chosen, 3). scale: points per metre. valued:
    whether colours show values, some of which are as light as the background.
    """
    from matplotlib.collections import EllipseCollection, LineCollection

    positions = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    radii = bodies.radius[chosen].astype(np.float64)
    mark = math.sqrt(marker_area(len(radii))) / 2
    radii = np.maximum(np.where(radii == 0, mark / scale, radii), _SMALLEST_RADIUS_POINTS / scale)
    points = float(radii.max()) * scale
    width = 0.0 if points < _HEADING_RADIUS_POINTS else min(max(points / 9, 0.5), 1.2)
    artists: list[Artist] = []
    discs = EllipseCollection(
        2 * radii, 2 * radii, np.zeros(len(radii)), units="xy", offsets=positions,
        offset_transform=axes.transData, facecolors=colors, edgecolors=INK if valued else PAPER,
        linewidths=width, zorder=4.0,
    )  # fmt: skip
    artists.append(axes.add_collection(discs))
    if points >= _HEADING_RADIUS_POINTS:
        heading = bodies.heading[chosen].astype(np.float64)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1) * radii[:, None]
        lines = LineCollection(
            list(np.stack([positions, positions + ahead], axis=1)),
            colors=[INK if bright else PAPER for bright in is_bright(colors)],
            linewidths=min(max(points / 4, 0.8), 2.2),
            zorder=4.1,
        )
        artists.append(axes.add_collection(lines))
    return artists


def draw_leds(
    axes: "Axes", bodies: Bodies, chosen: "NDArray[np.bool_]", color: "NDArray[np.float64]"
) -> "list[Artist]":
    """Draw the LEDs of robots in their middle, so that the robot's colour is visible around them."""
    from matplotlib.collections import EllipseCollection

    positions = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    widths = 2 * bodies.radius[chosen].astype(np.float64)
    discs = EllipseCollection(
        widths, widths, np.zeros(len(widths)), units="xy", offsets=positions, offset_transform=axes.transData,
        facecolors=color, edgecolors=PAPER, linewidths=0.5, zorder=4.2,
    )  # fmt: skip
    return [axes.add_collection(discs)]


def draw_wall_sections(
    axes: "Axes", bodies: Bodies, chosen: "NDArray[np.bool_]", colors: "NDArray[np.float64]"
) -> "list[Artist]":
    """Draw coloured wall sections: one radius along the heading to both sides of their middle."""
    from matplotlib.collections import LineCollection

    positions = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    heading = bodies.heading[chosen].astype(np.float64)
    far = np.stack([np.cos(heading), np.sin(heading)], axis=1) * bodies.radius[chosen][:, None]
    lines = LineCollection(
        list(np.stack([positions - far, positions + far], axis=1)), colors=colors[chosen], linewidths=3.2,
        capstyle="butt", zorder=1.85,
    )  # fmt: skip
    return [axes.add_collection(lines)]


def draw_rays(axes: "Axes", bodies: Bodies, colors: "NDArray[np.float64]") -> "list[Artist]":
    """Draw the rays of sensors, more opaque for larger readings."""
    from matplotlib.collections import LineCollection

    body, numbers = bodies.ray_body, bodies.ray_numbers.astype(np.float64)
    if not len(body):
        return []
    heading = np.nan_to_num(bodies.heading[body]).astype(np.float64)
    angle, start, length, reading = numbers.T
    along = np.stack([np.cos(heading + angle), np.sin(heading + angle)], axis=1)
    middle = np.stack([bodies.x[body], bodies.y[body]], axis=1)
    ends = np.stack([middle + along * start[:, None], middle + along * (start + length)[:, None]], axis=1)
    strong = 0.5 + 0.5 * np.nan_to_num(np.clip(reading, 0, 1))
    faces = np.column_stack([colors[body], strong])
    lines = LineCollection(list(ends), colors=faces, linewidths=RAY_WIDTH, zorder=3.5)
    return [_draw_halo(axes, list(ends), 3.45), axes.add_collection(lines)]


def draw_links(axes: "Axes", bodies: Bodies, pairs: "NDArray[np.integer]") -> "list[Artist]":
    """Draw lines between bodies that hear each other."""
    from matplotlib.collections import LineCollection

    positions = np.stack([bodies.x, bodies.y], axis=1)
    once = np.unique(np.sort(pairs, axis=1), axis=0)
    ends = list(positions[once])
    lines = LineCollection(ends, colors=BORDER, linewidths=LINK_WIDTH, zorder=1.6)
    return [_draw_halo(axes, ends, 1.58), axes.add_collection(lines)]


def _draw_halo(axes: "Axes", ends: "Sequence[NDArray[np.float64]]", layer: float) -> "Artist":
    """Draw a light line below each thin line, for contrast on a dark floor."""
    from matplotlib.collections import LineCollection

    halo = LineCollection(ends, colors=PAPER, alpha=HALO_SHARE, linewidths=HALO_WIDTH, zorder=layer)
    return axes.add_collection(halo)


_MOST_LABELS = 200
"""Largest number of labels that are drawn."""
_LABEL_CHARACTERS = 24
"""Longest label, in characters."""
_FONT_SIZE_POINTS = 8.0
"""Font size of labels, in points."""
_LETTER = 0.6
"""Approximate width of a letter, relative to the font size."""
_GAP_POINTS = 1.5
"""Points between a body and its label."""
_SIDES = ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
"""Sides of a body for its label, (right, up), in the order in which they are tried."""


class _Box(NamedTuple):
    """A rectangle, in points from the lower left corner of the map."""

    left: float
    low: float
    right: float
    high: float

    def overlaps(self, other: "_Box") -> bool:
        """Whether two boxes overlap."""
        beside = self.right <= other.left or other.right <= self.left
        return not (beside or self.high <= other.low or other.high <= self.low)


class Labels:
    """Labels of bodies; from frame to frame, a label stays on its side of the body if possible.

    scale: points per metre. least: radius in points of bodies that are drawn as markers.
    """

    def __init__(self, scale: float, *, least: float) -> None:
        self._scale = scale
        self._least = least
        self._sides: dict[int, int] = {}

    def draw(self, axes: "Axes", bodies: Bodies) -> "list[Artist]":
        """Draw the labels that fit; return the artists."""
        from matplotlib.patheffects import withStroke

        field = _Box(0.0, 0.0, axes.get_xlim()[1] * self._scale, axes.get_ylim()[1] * self._scale)
        space = _FreeSpace(bodies, self._scale, self._least, field)
        texts = [" ".join(text.split())[:_LABEL_CHARACTERS] for text in bodies.labels or ()]
        artists: list[Artist] = []
        for index in [index for index, text in enumerate(texts) if text][:_MOST_LABELS]:
            placement = space.take(index, len(texts[index]), self._sides.get(index))
            if placement is None:
                continue
            self._sides[index], (right, up) = placement
            artists.append(
                axes.annotate(
                    texts[index], (float(bodies.x[index]), float(bodies.y[index])),
                    xytext=(right, up + 0.15 * _FONT_SIZE_POINTS), textcoords="offset points", va="baseline",
                    fontsize=_FONT_SIZE_POINTS, color=INK, zorder=5.0, parse_math=False,
                    path_effects=[withStroke(linewidth=2.0, foreground=PAPER)],
                )
            )  # fmt: skip
        return artists


class _FreeSpace:
    """The part of a map that is free for labels. field: the whole map."""

    def __init__(self, bodies: Bodies, scale: float, least: float, field: _Box) -> None:
        self._radii = np.maximum(bodies.radius * scale, least).astype(np.float64)
        self._x, self._y = bodies.x * np.float64(scale), bodies.y * np.float64(scale)
        # LEDs are inside robots, and wall sections may be covered.
        self._is_obstacle = ~bodies.has(LED, STRETCH)
        self._largest = float(self._radii[self._is_obstacle].max(initial=0.0))
        self._field = field
        self._occupied: list[_Box] = []

    def take(self, index: int, letters: int, before: int | None) -> tuple[int, tuple[float, float]] | None:
        """Reserve space for a body's label; return its side and offset in points, None if there is no space.

        letters: number of letters of the label. before: the side in the previous frame, which is tried first.
        """
        wide, high = _LETTER * _FONT_SIZE_POINTS * letters, _FONT_SIZE_POINTS
        reach = wide + high + self._radii[index] + _GAP_POINTS + self._largest
        x, y = self._x, self._y
        neighbours = np.flatnonzero(
            self._is_obstacle & (abs(x - x[index]) < reach) & (abs(y - y[index]) < reach)
        )
        neighbours = neighbours[neighbours != index]
        for side, box in self._boxes(index, wide, high, before):
            is_inside = box.left >= 0 and box.low >= 0
            is_inside &= box.right <= self._field.right and box.high <= self._field.high
            if not is_inside or any(box.overlaps(other) for other in self._occupied):
                continue
            away = np.hypot(
                x[neighbours] - np.clip(x[neighbours], box.left, box.right),
                y[neighbours] - np.clip(y[neighbours], box.low, box.high),
            )
            if not (away < self._radii[neighbours]).any():
                self._occupied.append(box)
                return side, (float(box.left - x[index]), float(box.low - y[index]))
        return None

    def _boxes(self, index: int, wide: float, high: float, before: int | None) -> Iterator[tuple[int, _Box]]:
        """Yield the sides of a body and their boxes, the side of the previous frame first."""
        for side in sorted(range(len(_SIDES)), key=lambda side: side != before):
            right, up = _SIDES[side]
            # A label at a corner of the bounding square would be far from the disc.
            away = self._radii[index] * (0.75 if right and up else 1.0) + _GAP_POINTS
            left = float(self._x[index] + right * away - wide * (1 - right) / 2)
            low = float(self._y[index] + up * away - high * (1 - up) / 2)
            yield side, _Box(left, low, left + wide, low + high)


_NUMBERS = 12
"""Largest number of labels of an axis."""
_LINES = 64
"""Largest number of cells on a side with drawn borders; more would be illegible."""


def prepare_axes(axes: "Axes", scene: Scene) -> "Rectangle":
    """Prepare axes for scenes of this extent; return the rectangle of the map.

    Axes show metres in the simulation's coordinates, or rows and columns from the top left.
    """
    from matplotlib.patches import Rectangle

    margin = 0.012 * max(scene.width, scene.height)
    axes.set_xlim(-margin, scene.width + margin)
    axes.set_ylim(-margin, scene.height + margin)
    axes.set_aspect("equal")
    axes.patch.set_visible(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    field = Rectangle((0, 0), scene.width, scene.height, facecolor=FIELD, edgecolor="none", zorder=0)
    # With walls, the frame is thin to differ from them.
    thick = {"edgecolor": BORDER, "linewidth": 1.6, "zorder": 1.9}
    thin = {"edgecolor": mix(BORDER, FIELD, 0.5), "linewidth": 0.8, "zorder": 1.65}
    border = Rectangle((0, 0), scene.width, scene.height, fill=False, **(thin if len(scene.walls) else thick))  # type: ignore[arg-type] # valid for both
    axes.add_patch(field)
    axes.add_patch(border)
    axes.set_axisbelow(True)
    if scene.grid:
        _number_cells(axes, scene, field)
    else:
        axes.locator_params(integer=True)
        if any(scene.origin):
            _number_metres(axes, scene)
        axes.grid(color=GRID, linewidth=0.6, clip_path=field)
        _name_unit(axes)
    axes.tick_params(which="both", length=0, labelsize=9, colors=BORDER)
    return field


def _name_unit(axes: "Axes") -> None:
    """Write the unit at the origin of the axes."""
    axes.annotate(
        "m", (0, 0), xycoords="axes fraction", xytext=(-3.5, -3.5), textcoords="offset points", ha="right",
        va="top", fontsize=9, color=BORDER,
    )  # fmt: skip


def _number_metres(axes: "Axes", scene: Scene) -> None:
    """Number the axes in the simulation's coordinates."""
    from matplotlib.ticker import MaxNLocator

    sides = zip((axes.xaxis, axes.yaxis), scene.origin, (scene.width, scene.height), strict=True)
    for axis, low, extent in sides:
        numbers = MaxNLocator(_NUMBERS, integer=True).tick_values(low, low + extent)
        numbers = [number for number in numbers if low <= number <= low + extent]
        axis.set_ticks(
            [number - low for number in numbers], [f"{number:g}".replace("-", "\u2212") for number in numbers]
        )


def _number_cells(axes: "Axes", scene: Scene, field: "Rectangle") -> None:
    """Number columns and rows at the middle of their cells, with lines between cells."""
    columns, rows = round(scene.width), round(scene.height)
    step = cell_step(max(columns, rows))
    axes.set_xticks([i + 0.5 for i in range(0, columns, step)], [str(i) for i in range(0, columns, step)])
    axes.set_yticks([rows - j - 0.5 for j in range(0, rows, step)], [str(j) for j in range(0, rows, step)])
    if max(columns, rows) <= _LINES:
        axes.set_xticks(range(columns + 1), minor=True)
        axes.set_yticks(range(rows + 1), minor=True)
        axes.grid(which="minor", color=GRID, linewidth=0.5, clip_path=field)


def cell_step(cells: int) -> int:
    """Return the distance of axis numbers in cells: 1, 2, 5, 10, 20, ..."""
    power = 1
    while True:
        for factor in (1, 2, 5):
            if cells / (factor * power) <= _NUMBERS:
                return factor * power
        power *= 10


def ground_of(scene: Scene) -> tuple[object, ...]:
    """Return the static parts of a scene, for comparison."""
    return (scene.floor, tuple(scene.patches), tuple(scene.walls), tuple(scene.lights))


def draw_ground(axes: "Axes", scene: Scene) -> "list[Artist]":
    """Draw floor, walls and lamps; return the artists."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Polygon, Rectangle

    drawn: list[Artist] = []
    edge: Drawn | None = None
    floor = [] if scene.floor is None else [floor_patch(scene)]
    for patch in [*floor, *scene.patches]:
        shape = _shape(patch)
        # zorder: the grid (0.5) is above the floor and below the patches.
        shape.set(
            facecolor=floor_color(patch.grey), edgecolor="none", zorder=0.6 if edge or not floor else 0.2
        )
        axes.add_patch(shape)
        if edge is None and floor:
            edge = shape
        elif edge is not None:
            shape.set_clip_path(edge)
        drawn.append(shape)
    for light in scene.lights:
        on = light.intensity > 0
        glow = 0.05 * max(scene.width, scene.height)
        for share in (1.0, 0.7, 0.45) if on else ():
            circle = Circle((light.x, light.y), glow * share, color=ORANGE, alpha=0.14, lw=0, zorder=0.7)
            drawn.append(axes.add_patch(circle))
            circle.set_clip_path(Rectangle((0, 0), scene.width, scene.height, transform=axes.transData))
        style: dict[str, Any] = {
            "color": ORANGE if on else FIELD,
            "markeredgecolor": BORDER,
            "markeredgewidth": 0.8,
        }
        lamp = Line2D([light.x], [light.y], marker="o", markersize=6, linestyle="", zorder=1.7, **style)
        drawn.append(axes.add_line(lamp))
    for wall in scene.walls:
        if wall.solid:
            solid = Polygon(list(wall.points), facecolor=BORDER, edgecolor=BORDER, zorder=1.7, lw=1.0)
            drawn.append(axes.add_patch(solid))
        else:
            xs, ys = zip(*wall.points, strict=True)
            line = Line2D(xs, ys, color=BORDER, linewidth=2.4, zorder=1.8, solid_joinstyle="round")
            drawn.append(axes.add_line(line))
    return drawn


def _shape(patch: Patch) -> "Drawn":
    from matplotlib.patches import Circle, Polygon

    if len(patch.points) == 1:
        return Circle(patch.points[0], patch.radius)
    return Polygon(list(patch.points))


TRAIL_STEPS = 12
"""Length of a trail in an animation, in steps."""
LONG_TRAIL_STEPS, LONG = 60, 300
"""Length of a trail in episodes with more steps than LONG, whose steps are short."""
MOST_TRAILS = 1000
"""Largest number of moving bodies with trails; more would hide the map."""
MOST_POINTS = 400
"""Largest number of points of the trail of a whole episode."""

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.42, 0.2, 0.45, 0.72
"""Width of the picture and margins for numbers, title and legend, in inches."""
STATUS, SECONDS = 2.6, 0.7
"""Inches beside the title for step and fitness, and for seconds."""
LONGEST_MESSAGE = 100


class Picture:
    """A figure for drawing the scenes of a recording.

    shows: the recording, or a part with information on its controller. dpi: pixels per inch; a picture is 7
    inches wide. shown: optional parts of the picture. still: whether only the last scene is drawn.
    """

    @use_plain_settings()
    def __init__(
        self, shows: Recording | Part, *, dpi: int, shown: Shown | None = None, still: bool = False
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        part = Part.from_recording(shows)
        recording = self._recording = part.recording
        self._seconds = part.step_seconds
        self._shown = shown or Shown()
        first = recording.scenes[0]
        self._size = _marker_area(first)
        self._looks = Looks(recording.scenes)
        self._colors = {look: np.array(to_rgb(self._looks.color(look))) / 255 for look in self._looks.names()}
        states = None if recording.trace is None else recording.trace.states
        self._states = states if self._shown.colors == "controller" else None
        self._valued = self._states is None and self._shown.colors != "state"
        self._state_colors: StateColors | None = None
        if self._states is not None:
            self._state_colors = StateColors.from_machines(
                part.machines, self._states, Bodies.from_bodies(first.bodies)
            )
        self._changing = self._states is not None or (self._valued and scale_of(recording) is not None)
        names = self._state_colors.labels if self._state_colors is not None else ()
        self.states = len(names)
        """Number of controller states that determine colours."""
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
        self._field = prepare_axes(self._axes, first)
        # Points per metre or cell.
        self._scale = 72 * min((WIDTH - LEFT - RIGHT) / first.width, inside / first.height) / 1.024
        ground = ground_of(first)
        self._still = all(ground_of(scene) == ground for scene in recording.scenes)
        if self._still:
            draw_ground(self._axes, first)
        self._paths = _paths(recording.scenes) if self._shown.trails else {}
        self._past_colors: dict[int, NDArray[np.float64]] = {}
        self._labels = Labels(self._scale, least=math.sqrt(self._size) / 2)
        self._draw_title(first)
        self._key.draw(self.figure)
        self._ground: Any = None  # the static parts, drawn once

    @use_plain_settings()
    def image(self, scene: Scene, time: float) -> "Image":
        """Draw the scene as an RGB image with fading trails. time: in steps."""
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
        """Draw a scene on the figure; return the artists.

        time: in steps, may be fractional.
        trail: length of trails in steps; None: the whole episode.
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
            artists += draw_ground(self._axes, scene)
        bodies = Bodies.from_bodies(scene.bodies)
        colors = self._colors_of(bodies, int(time))
        artists += self._draw_trails(bodies, colors, time, trail)
        if trail is None:
            artists += self._draw_starts()
        if self._shown.rays:
            artists += draw_rays(self._axes, bodies, colors)
        if self._shown.links and len(scene.links):
            artists += draw_links(self._axes, bodies, np.asarray(scene.links))
        directed = ~np.isnan(bodies.heading)
        for index, look in enumerate(bodies.looks):
            has_look = bodies.look == index
            if look[0] == LED:
                if look[1] and has_look.any():
                    artists += draw_leds(self._axes, bodies, has_look, self._colors[look])
                continue
            if look[0] == STRETCH and (has_look & directed).any():
                artists += draw_wall_sections(self._axes, bodies, has_look & directed, colors)
                has_look &= ~directed
            if has_look[~directed].any():
                artists += self._draw_bodies(bodies, has_look & ~directed, look, colors)
            if has_look[directed].any():
                chosen = has_look & directed
                valued = self._valued and not np.isnan(bodies.value[chosen]).all()
                artists += draw_robots(self._axes, bodies, chosen, colors[chosen], self._scale, valued=valued)
        if self._shown.labels is not False and bodies.labels:
            artists += self._labels.draw(self._axes, bodies)
        return artists

    def _colors_of(self, bodies: Bodies, time: int) -> "NDArray[np.float64]":
        """Return the colours of all bodies, (bodies, 3): by kind and state, value, or controller state."""
        by_look = np.array([self._colors[look] for look in bodies.looks]).reshape(-1, 3)
        colors = by_look[bodies.look]
        valued = ~np.isnan(bodies.value)
        if self._valued and valued.any():
            colors[valued] = value_colors(self._key.shares(bodies.value[valued]))
        if self._states is not None and self._state_colors is not None:
            agents = bodies.agents()
            with_states = np.flatnonzero((agents >= 0) & (agents < self._states.shape[1]))
            current_states = self._states[min(time, len(self._states) - 1), agents[with_states]]
            with_states, current_states = (
                with_states[current_states >= 0],
                current_states[current_states >= 0],
            )
            current_states = current_states + self._state_colors.first[agents[with_states]]
            colors[with_states] = (
                np.array([to_rgb(state_color(state)) for state in range(len(STATES))])[
                    current_states % len(STATES)
                ]
                / 255
            )
        return colors

    def _draw_title(self, scene: Scene) -> None:
        # The message is plain text without formulas.
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

    def _draw_trails(
        self, bodies: Bodies, colors: "NDArray[np.float64]", time: float, trail: int | None
    ) -> "list[Artist]":
        from matplotlib.collections import LineCollection

        newest = int(time)
        oldest = 0 if trail is None else max(0, newest - trail)
        stride = 1 if trail is not None else -(-(newest + 1) // MOST_POINTS)
        pieces: list[NDArray[np.float64]] = []
        shades: list[NDArray[np.float64]] = []
        ground = np.array(to_rgb(FIELD)) / 255
        # Colours of kind and state are constant along a trail; other colours change from piece to piece.
        steps = range(oldest, newest + 1, stride) if self._changing else ()
        past = np.array([self._find_past_colors(step) for step in steps])
        for number, (index, path) in enumerate(self._paths.items()):
            points = np.vstack([path[oldest : newest + 1 : stride], [[bodies.x[index], bodies.y[index]]]])
            count = len(points) - 1
            share = np.full(count, 0.65) if trail is None else np.linspace(0.1, 0.65, count)
            pieces.extend(np.stack([points[:-1], points[1:]], axis=1))
            color = past[:, number] if self._changing else colors[index]
            # Opaque, since overlapping round ends of transparent pieces would show as dots.
            shades.append(share[:, None] * color + (1 - share[:, None]) * ground)
        if not pieces:
            return []
        # Thin lines in long episodes, which would cover the floor.
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

    def _find_past_colors(self, step: int) -> "NDArray[np.float64]":
        """Return the colours of all bodies with trails at a step, (trails, 3)."""
        if step not in self._past_colors:
            bodies = Bodies.from_bodies(self._recording.scenes[step].bodies)
            self._past_colors[step] = self._colors_of(bodies, step)[list(self._paths)]
        return self._past_colors[step]

    def _draw_starts(self) -> "list[Artist]":
        """Draw small rings at the start of all trails."""
        if not self._paths:
            return []
        first = Bodies.from_bodies(self._recording.scenes[0].bodies)
        positions = np.array([way[0] for way in self._paths.values()])
        colors = self._colors_of(first, 0)[list(self._paths)]
        size = min(max(6.0, self._size / 5), 20.0)
        return [
            self._axes.scatter(
                positions[:, 0],
                positions[:, 1],
                s=size,
                c=FIELD,
                edgecolors=colors.tolist(),
                linewidths=1.0,
                zorder=1.3,
            )
        ]

    def _draw_bodies(
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
            return [self._draw_squares(positions, color, layer)]
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

    def _draw_squares(self, middles: "NDArray[np.float32]", color: str, layer: float) -> "Artist":
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
    """Return the marker area of an agent in points squared; in a grid it fills most of a cell."""
    if not scene.grid:
        return agent_size(scene)
    cell = 72 * (WIDTH - LEFT - RIGHT) / max(scene.width, scene.height)
    return min(max((0.6 * cell) ** 2, 3.0), 250.0)


def _paths(scenes: "Sequence[Scene]") -> "dict[int, NDArray[np.float64]]":
    """Return positions over time, (scenes, 2), of moving bodies; empty if bodies appear or disappear."""
    scene_bodies = [Bodies.from_bodies(scene.bodies) for scene in scenes]
    first = scene_bodies[0]
    indices = np.flatnonzero(is_moving(first))
    if len(indices) > MOST_TRAILS or any(len(bodies) != len(first) for bodies in scene_bodies):
        return {}
    xs = np.array([bodies.x[indices] for bodies in scene_bodies], dtype=np.float64)
    ys = np.array([bodies.y[indices] for bodies in scene_bodies], dtype=np.float64)
    return {int(body): np.stack([xs[:, k], ys[:, k]], axis=1) for k, body in enumerate(indices)}
