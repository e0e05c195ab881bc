"""Drawing of bodies with a heading, in true size, with rays and links."""

import math
from typing import TYPE_CHECKING

import numpy as np

from swarmwright.display._bodies import Bodies
from swarmwright.display._look import (
    BORDER,
    HALO_SHARE,
    HALO_WIDTH,
    INK,
    PAPER,
    is_bright,
    marker_area,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

_SMALLEST_RADIUS_POINTS = 1.3
"""Smallest drawn radius in points, so that bodies are visible."""
_HEADING_RADIUS_POINTS = 2.2
"""Smallest radius in points at which a heading line is drawn."""
RAY_WIDTH, LINK_WIDTH = 0.9, 0.8
"""Line widths in points."""


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
