"""Draws bodies that have a heading, in their true size, with what they sense and send."""

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
"""Radius in points below which bodies are drawn larger than they are, so that they can be seen."""
_HEADING_RADIUS_POINTS = 2.2
"""Radius in points from which on a line shows where they look."""
RAY_WIDTH, LINK_WIDTH = 0.9, 0.8
"""Points."""


def robots(
    axes: "Axes",
    bodies: Bodies,
    chosen: "NDArray[np.bool_]",
    colors: "NDArray[np.float64]",
    scale: float,
    *,
    valued: bool,
) -> "list[Artist]":
    """Draw discs with a line from the middle to where they look; without a radius as large as marks.

    chosen: (bodies,) which. colors: theirs, (chosen, 3). scale: points for each metre. valued: whether
    colours are those of values, of which some are as light as the ground.
    """
    from matplotlib.collections import EllipseCollection, LineCollection

    places = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    radii = bodies.radius[chosen].astype(np.float64)
    mark = math.sqrt(marker_area(len(radii))) / 2
    radii = np.maximum(np.where(radii == 0, mark / scale, radii), _SMALLEST_RADIUS_POINTS / scale)
    points = float(radii.max()) * scale
    width = 0.0 if points < _HEADING_RADIUS_POINTS else min(max(points / 9, 0.5), 1.2)
    artists: list[Artist] = []
    discs = EllipseCollection(
        2 * radii, 2 * radii, np.zeros(len(radii)), units="xy", offsets=places,
        offset_transform=axes.transData, facecolors=colors, edgecolors=INK if valued else PAPER,
        linewidths=width, zorder=4.0,
    )  # fmt: skip
    artists.append(axes.add_collection(discs))
    if points >= _HEADING_RADIUS_POINTS:
        heading = bodies.heading[chosen].astype(np.float64)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1) * radii[:, None]
        lines = LineCollection(
            list(np.stack([places, places + ahead], axis=1)),
            colors=[INK if bright else PAPER for bright in is_bright(colors)],
            linewidths=min(max(points / 4, 0.8), 2.2),
            zorder=4.1,
        )
        artists.append(axes.add_collection(lines))
    return artists


def leds(
    axes: "Axes", bodies: Bodies, chosen: "NDArray[np.bool_]", color: "NDArray[np.float64]"
) -> "list[Artist]":
    """Draw what robots show, in the middle of them: their own colour is seen around it."""
    from matplotlib.collections import EllipseCollection

    places = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    widths = 2 * bodies.radius[chosen].astype(np.float64)
    discs = EllipseCollection(
        widths, widths, np.zeros(len(widths)), units="xy", offsets=places, offset_transform=axes.transData,
        facecolors=color, edgecolors=PAPER, linewidths=0.5, zorder=4.2,
    )  # fmt: skip
    return [axes.add_collection(discs)]


def stretches(
    axes: "Axes", bodies: Bodies, chosen: "NDArray[np.bool_]", colors: "NDArray[np.float64]"
) -> "list[Artist]":
    """Draw coloured parts of walls: a radius long along the heading, to both sides of their middle."""
    from matplotlib.collections import LineCollection

    places = np.stack([bodies.x[chosen], bodies.y[chosen]], axis=1).astype(np.float64)
    heading = bodies.heading[chosen].astype(np.float64)
    far = np.stack([np.cos(heading), np.sin(heading)], axis=1) * bodies.radius[chosen][:, None]
    lines = LineCollection(
        list(np.stack([places - far, places + far], axis=1)), colors=colors[chosen], linewidths=3.2,
        capstyle="butt", zorder=1.85,
    )  # fmt: skip
    return [axes.add_collection(lines)]


def rays(axes: "Axes", bodies: Bodies, colors: "NDArray[np.float64]") -> "list[Artist]":
    """Draw what sensors look along; the more they read, the stronger."""
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
    return [_halo(axes, list(ends), 3.45), axes.add_collection(lines)]


def links(axes: "Axes", bodies: Bodies, pairs: "NDArray[np.integer]") -> "list[Artist]":
    """Draw a line between bodies of which one hears the other."""
    from matplotlib.collections import LineCollection

    places = np.stack([bodies.x, bodies.y], axis=1)
    once = np.unique(np.sort(pairs, axis=1), axis=0)
    ends = list(places[once])
    lines = LineCollection(ends, colors=BORDER, linewidths=LINK_WIDTH, zorder=1.6)
    return [_halo(axes, ends, 1.58), axes.add_collection(lines)]


def _halo(axes: "Axes", ends: "Sequence[NDArray[np.float64]]", layer: float) -> "Artist":
    """Draw a light line below each thin one, which could not be seen on a dark floor."""
    from matplotlib.collections import LineCollection

    halo = LineCollection(ends, colors=PAPER, alpha=HALO_SHARE, linewidths=HALO_WIDTH, zorder=layer)
    return axes.add_collection(halo)
