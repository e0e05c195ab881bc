"""A mission of the arena with its axes, its origin and the keys that describe each part.

`python -m benchmarks.mission_keys [FILE]` draws the mission of docs/how-to/own-mission.md, with robots where
a seed puts them, into FILE, by default docs/images/mission.png.
"""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from ruamel.yaml import YAML

from swarmwright import Episodes
from swarmwright.display import Scene
from swarmwright.display._look import BORDER, to_rgb
from swarmwright.display._scene import Bodies
from swarmwright.display.drawing import draw_ground, draw_robots, prepare_axes
from swarmwright.display.figures.style import COLORS, INK, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
PAGE, IMAGE = ROOT / "docs/how-to/own-mission.md", ROOT / "docs/images/mission.png"
NAME = "my_mission.yaml"
SEED = 3
WIDTH, HEIGHT = 9.0, 5.0
"""Inches."""
BESIDE, ABOVE = 1.0, 0.62
"""Metres beside, and above and below the map, where words are."""
NUMBERS = (-1, 0, 1)
"""Metres, beside the map."""
ACCENT = COLORS[1]

Point = tuple[float, float]


def mission() -> dict[str, Any]:
    """Return the mission of the page."""
    block = re.search(rf"^```yaml file={NAME}\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert block is not None, PAGE
    read: dict[str, Any] = YAML(typ="safe").load(block[1])
    return read


def draw(values: dict[str, Any]) -> "Figure":
    """Draw a mission as it begins, and the keys of its parts."""
    from matplotlib.patches import Rectangle

    scene = Episodes("arena", {"mission": values}, seeds=[SEED]).scene()
    figure = new_figure(WIDTH, HEIGHT)
    axes = figure.subplots()
    prepare_axes(axes, scene)
    draw_ground(axes, scene)
    bodies = Bodies.from_bodies(scene.bodies)
    agents = bodies.has("agent")
    color = np.tile(np.array(to_rgb(COLORS[0])) / 255, (int(agents.sum()), 1))
    draw_robots(axes, bodies, agents, color, 72 * WIDTH / (scene.width + 2 * BESIDE), valued=False)
    axes.set_xlim(-BESIDE, scene.width + BESIDE)
    axes.set_ylim(-ABOVE, scene.height + ABOVE)
    x, y = (values["start"]["rectangle"][side] for side in "xy")
    corner = _place(scene, (x[0], y[0]))
    start = Rectangle(corner, x[1] - x[0], y[1] - y[0], fill=False, ec=ACCENT, ls="--", lw=1.4, zorder=3.0)
    axes.add_patch(start)
    _show_axes(axes, scene)
    _show_keys(axes, scene, values)
    return figure


def _place(scene: Scene, point: Point) -> Point:
    """Return a point of the mission in the coordinates of the axes, which begin at the bottom left corner."""
    return point[0] - scene.origin[0], point[1] - scene.origin[1]


def _show_axes(axes: "Axes", scene: Scene) -> None:
    """Draw the origin, and the directions of x, y and angles."""
    origin = _place(scene, (0, 0))
    style = {"arrowstyle": "-|>", "color": ACCENT, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
    for tip, name, offset in (((0.24, 0), "x", (-2, 9)), ((0, 0.24), "y", (-9, -2))):
        axes.annotate("", _place(scene, tip), origin, arrowprops=style, zorder=6)
        axes.annotate(
            name, _place(scene, tip), xytext=offset, textcoords="offset points", color=ACCENT, fontsize=12,
            fontweight="bold", ha="center", va="center", zorder=6,
        )  # fmt: skip
    axes.plot(*origin, "o", color=ACCENT, markersize=6, zorder=6)
    axes.annotate(
        "(0, 0)", origin, xytext=(0, -12), textcoords="offset points", color=ACCENT, fontsize=10, ha="center",
        va="center", fontweight="bold", zorder=6,
    )  # fmt: skip
    axes.set(xticks=[], yticks=[])
    axes.texts[0].remove()  # the unit, which would be far from the map
    for number in NUMBERS:
        words = f"{number:g}".replace("-", "\u2212")
        x, y = _place(scene, (number, number))
        style = {"fontsize": 10, "color": BORDER}
        axes.text(x, -0.04, f"x = {words}", ha="center", va="top", **style)  # type: ignore[arg-type] # as text takes them
        axes.text(-0.04, y, f"y = {words}", ha="right", va="center", **style)  # type: ignore[arg-type] # as above


def _show_keys(axes: "Axes", scene: Scene, values: dict[str, Any]) -> None:
    """Write the keys of each part beside the map, with a line to the part."""
    source, nest = values["floor"]["patches"]
    light, obstacle, start = values["lights"][0], values["obstacles"][0], values["start"]["rectangle"]
    walls, x, y = values["walls"]["rectangle"], nest["rectangle"]["x"], nest["rectangle"]["y"]
    wide, high = (side / 2 for side in walls)
    robot = min(Bodies.from_bodies(scene.bodies), key=lambda body: body.y)
    at, radius = source["circle"]["center"], source["circle"]["radius"]
    above, below, east, west = high + 0.12, -high - 0.22, wide + 0.16, -wide - 0.5
    keys: tuple[tuple[str, Point, Point, str, str], ...] = (
        (f"walls:\n  rectangle: {walls}", (east, -0.5), (wide, -0.66), "left", "center"),
        (
            f"floor: patches:\n  name: {source['name']}\n  circle:\n    center: {at}\n    radius: {radius}",
            (east, 0.4), (at[0] + radius, at[1]), "left", "center",
        ),
        (
            f"floor: patches:\n  name: {nest['name']}\n  rectangle:\n    x: {x}\n    y: {y}",
            (-wide - 0.1, above), (-wide + 0.2, high - 0.15), "left", "bottom",
        ),
        (
            f"obstacles:\n  center: {obstacle['center']}\n  size: {obstacle['size']}",
            (obstacle["center"][0] - 0.1, above), (obstacle["center"][0], high - 0.15), "left", "bottom",
        ),
        (f"lights:\n  at: {light['at']}", (west + 0.2, -0.45), tuple(light["at"][:2]), "right", "center"),
        (
            f"start: rectangle:\n  x: {start['x']}\n  y: {start['y']}", (start["x"][0] - 0.3, below),
            (start["x"][0] + 0.1, start["y"][0]), "left", "top",
        ),
        (
            f"robots: {values['robots']}", (0.3, below),
            (robot.x + scene.origin[0], robot.y + scene.origin[1]), "left", "top",
        ),
    )  # fmt: skip
    for words, place, part, across, up in keys:
        axes.annotate(
            words, _place(scene, part), _place(scene, place), ha=across, va=up, fontsize=10, color=INK,
            family="monospace", zorder=7,
            arrowprops={"arrowstyle": "-", "color": INK, "lw": 1, "shrinkA": 2, "shrinkB": 0},
        )  # fmt: skip


def main() -> None:
    """Draw what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mission_keys", description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", default=IMAGE, metavar="FILE")
    draw(mission()).savefig(parser.parse_args().file)


if __name__ == "__main__":
    main()
