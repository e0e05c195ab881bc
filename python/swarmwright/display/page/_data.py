"""An episode as the page's script reads it."""

import base64
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swarmwright.display._episode import Recording
from swarmwright.display._look import CELLS, MOVING, SHAPES, Looks
from swarmwright.display._scene import Body, Scene

if TYPE_CHECKING:
    from PIL.Image import Image

    from swarmwright.display.pictures import PictureRecording

_DIGITS = 5
"""Significant digits of a position: finer than a pixel of any screen."""
_MOST_PICTURES = 300
"""Pictures on a page."""
_LARGEST_PICTURE = (560, 560)
"""Pixels of one."""

_TABLES = {
    "shapes": {name: path for name, (_, path) in SHAPES.items()},
    "cells": list(CELLS),
    "moving": list(MOVING),
}
"""What is the same on all pages."""


def episode_data(recording: Recording, *, speed: float) -> dict[str, Any]:
    """Return the episode as plain values.

    width, height, grid and message of the world; step_seconds and speed; fitness so far at each scene, null
    where it is not finite; looks: shape and colour by label; shapes as paths; cells, moving: the kinds
    that fill a cell of a grid, and that leave trails; and bodies: kind, radius, x and y at each scene (one
    number for what never moves, null where it is not there), and states as [scene from which, state].
    """
    scenes = recording.scenes
    first = scenes[0]
    count = max(len(scene.bodies) for scene in scenes)
    return {
        "message": first.message,
        "width": first.width,
        "height": first.height,
        "grid": first.grid,
        "step_seconds": max(recording.step_size, 0.02),
        "speed": speed,
        "fitness": [_number(value, 9) for value in recording.fitness_so_far],
        "bodies": [_body(scenes, index) for index in range(count)],
        "looks": Looks(scenes).plain(),
        **_TABLES,
    }


def picture_data(recording: "PictureRecording", *, speed: float) -> dict[str, Any]:
    """Return an episode in pictures as plain values, as `episode_data` without bodies.

    pictures: JPEG, as addresses that hold the data; picture_steps: the step of each.
    """
    count = min(len(recording.pictures), _MOST_PICTURES)
    last = len(recording.pictures) - 1
    chosen = sorted({round(place * last / max(count - 1, 1)) for place in range(count)})
    images = [recording.image(index) for index in chosen]
    return {
        "message": "",
        "width": images[0].width,
        "height": images[0].height,
        "grid": False,
        "step_seconds": max(recording.step_size, 0.02),
        "speed": speed,
        "fitness": [_number(value, 9) for value in recording.fitness_so_far],
        "bodies": [],
        "looks": {},
        **_TABLES,
        "pictures": [_jpeg(image) for image in images],
        "picture_steps": [recording.steps[index] for index in chosen],
    }


def _jpeg(image: "Image") -> str:
    buffer = io.BytesIO()
    image.thumbnail(_LARGEST_PICTURE)
    image.save(buffer, "JPEG", quality=80)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _body(scenes: Sequence[Scene], index: int) -> dict[str, Any]:
    bodies = [scene.bodies[index] if index < len(scene.bodies) else None for scene in scenes]
    known = next(body for body in bodies if body is not None)
    return {
        "kind": known.kind,
        "radius": _number(known.radius, _DIGITS),
        "x": _series([None if body is None else body.x for body in bodies]),
        "y": _series([None if body is None else body.y for body in bodies]),
        "states": _changes(bodies),
    }


def _series(values: Sequence[float | None]) -> Any:  # noqa: ANN401 - a list, or the one number that it repeats
    numbers = [None if value is None else _number(value, _DIGITS) for value in values]
    return numbers[0] if numbers[0] is not None and len(set(numbers)) == 1 else numbers


def _changes(bodies: Sequence[Body | None]) -> list[tuple[int, str]]:
    changes: list[tuple[int, str]] = []
    for index, body in enumerate(bodies):
        if body is not None and (not changes or changes[-1][1] != body.state):
            changes.append((index, body.state))
    return changes


def _number(value: float, digits: int) -> float | None:
    return float(f"{value + 0.0:.{digits}g}") if math.isfinite(value) else None
