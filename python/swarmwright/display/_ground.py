"""The background of a picture: the map with its border, grid and numbers."""

from typing import TYPE_CHECKING, Any

from swarmwright.display._look import BORDER, FIELD, GRID, ORANGE, floor_color, mixed, whole
from swarmwright.display._scene import Patch, Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch as Drawn
    from matplotlib.patches import Rectangle

_NUMBERS = 12
"""Most numbers on a side."""
_LINES = 64
"""Most cells on a side whose borders are drawn; more would be illegible."""


def frame(axes: "Axes", scene: Scene) -> "Rectangle":
    """Prepare axes for scenes of this extent; return the part of them that is the map.

    Their numbers are metres in the coordinates of the simulation, or rows and columns from the top left.
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
    # Where there are walls, a thin frame does not look like one of them.
    thick = {"edgecolor": BORDER, "linewidth": 1.6, "zorder": 1.9}
    thin = {"edgecolor": mixed(BORDER, FIELD, 0.5), "linewidth": 0.8, "zorder": 1.65}
    border = Rectangle((0, 0), scene.width, scene.height, fill=False, **(thin if len(scene.walls) else thick))  # type: ignore[arg-type] # both are as it takes them
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
    """Write the unit of the numbers where both axes begin."""
    axes.annotate(
        "m", (0, 0), xycoords="axes fraction", xytext=(-3.5, -3.5), textcoords="offset points", ha="right",
        va="top", fontsize=9, color=BORDER,
    )  # fmt: skip


def _number_metres(axes: "Axes", scene: Scene) -> None:
    """Put numbers of the simulation's own coordinates beside the map."""
    from matplotlib.ticker import MaxNLocator

    sides = zip((axes.xaxis, axes.yaxis), scene.origin, (scene.width, scene.height), strict=True)
    for axis, low, extent in sides:
        numbers = MaxNLocator(_NUMBERS, integer=True).tick_values(low, low + extent)
        numbers = [number for number in numbers if low <= number <= low + extent]
        axis.set_ticks(
            [number - low for number in numbers], [f"{number:g}".replace("-", "\u2212") for number in numbers]
        )


def _number_cells(axes: "Axes", scene: Scene, field: "Rectangle") -> None:
    """Put the number of a column or a row at the middle of its cells, lines between cells."""
    columns, rows = round(scene.width), round(scene.height)
    step = cell_step(max(columns, rows))
    axes.set_xticks([i + 0.5 for i in range(0, columns, step)], [str(i) for i in range(0, columns, step)])
    axes.set_yticks([rows - j - 0.5 for j in range(0, rows, step)], [str(j) for j in range(0, rows, step)])
    if max(columns, rows) <= _LINES:
        axes.set_xticks(range(columns + 1), minor=True)
        axes.set_yticks(range(rows + 1), minor=True)
        axes.grid(which="minor", color=GRID, linewidth=0.5, clip_path=field)


def cell_step(cells: int) -> int:
    """The distance of numbers in cells: 1, 2, 5, 10, 20, ..."""
    power = 1
    while True:
        for factor in (1, 2, 5):
            if cells / (factor * power) <= _NUMBERS:
                return factor * power
        power *= 10


def ground_of(scene: Scene) -> tuple[object, ...]:
    """Return all that lies and stands in a scene, to compare it with another's."""
    return (scene.floor, tuple(scene.patches), tuple(scene.walls), tuple(scene.lights))


def lay(axes: "Axes", scene: Scene) -> "list[Artist]":
    """Draw floor, walls and lamps; return what was drawn."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Polygon, Rectangle

    drawn: list[Artist] = []
    edge: Drawn | None = None
    floor = [] if scene.floor is None else [whole(scene)]
    for patch in [*floor, *scene.patches]:
        shape = _shape(patch)
        # The grid, at 0.5, is above the floor and below its patches.
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
