"""Positions of sensors and actuators on a robot, from the names and the robot that a simulation describes."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import engine_errors
from swarmwright.simulations import catalogue

Position = tuple[float, float]
"""x ahead and y to the left, within a circle of radius 1."""
_DIRECTIONS = {
    "ahead": 0, "front": 0, "forward": 0, "middle": 0, "x": 0, "left": 90, "y": 90, "back": 180, "rear": 180,
    "right": 270, "E": 0, "NE": 45, "N": 90, "NW": 135, "W": 180, "SW": 225, "S": 270, "SE": 315,
}  # fmt: skip
"""Words in names, and their directions in degrees counter-clockwise from ahead; of the world from east."""
_DIGITS = 4
"""Decimals of positions, which so do not depend on the C library's sine."""


def positions(
    simulation: str, parameters: dict[str, Any]
) -> tuple[list[Position] | None, list[Position] | None]:
    """Return positions of sensors and of actuators; None where no name tells a direction.

    Values of a kind lie on a circle, each kind on its own: those that are numbered from 0 in the directions
    of the robot's proximity rays, if there are as many, otherwise evenly from ahead, counter-clockwise; those
    with other numbers at these angles in degrees; others by words such as left, NE or x. Values without a
    direction lie in the middle.

    Raises InputError like `catalogue.description`.
    """
    described = catalogue.description(simulation, parameters)
    rays = _proximity_rays(simulation, parameters)
    sensors, actuators = (positions_of(described[f"{noun}_names"], rays) for noun in ("sensor", "actuator"))
    return sensors, actuators


def _proximity_rays(simulation: str, parameters: Mapping[str, Any]) -> list[float]:
    """Return the directions of a robot's proximity rays, in degrees; none of swarms with several models."""
    if catalogue.find_built_in(simulation) != catalogue.ARENA:
        return []
    with engine_errors():
        models = _engine.rays(dict(parameters))
    return [math.degrees(ray) for ray in models[0]] if len(models) == 1 else []


def positions_of(names: Sequence[str], rays: Sequence[float]) -> list[Position] | None:
    """Return the position for each name; None if no name tells a direction.

    rays: directions of proximity rays, in degrees.
    """
    split = [_split(name) for name in names]
    numbers: dict[str, list[int]] = {}
    for kind, number, _ in split:
        if number is not None:
            numbers.setdefault(kind, []).append(number)
    angles = [_angle(parts, numbers, rays) for parts in split]
    kinds = list(
        dict.fromkeys(kind for (kind, *_), angle in zip(split, angles, strict=True) if angle is not None)
    )
    if not kinds:
        return None
    result = []
    for (kind, *_), angle in zip(split, angles, strict=True):
        radius = 0.0 if angle is None else 1 - kinds.index(kind) / len(kinds)
        turned = math.radians(angle or 0.0)
        x, y = (round(radius * part, _DIGITS) + 0.0 for part in (math.cos(turned), math.sin(turned)))
        result.append((x, y))
    return result


def _split(name: str) -> tuple[str, int | None, float | None]:
    """Return the kind of a value, its number if its name ends with one, and the direction of a word in it."""
    match = re.fullmatch(r"(.*?)\s*(\d{1,6})", name)
    if match:
        return match[1], int(match[2]), None
    words = name.split()
    directions = [word for word in words if word in _DIRECTIONS]
    if not directions:
        return name, None, None
    return (
        " ".join(word for word in words if word != directions[-1]),
        None,
        float(_DIRECTIONS[directions[-1]]),
    )


def _angle(
    parts: tuple[str, int | None, float | None], numbers: Mapping[str, Sequence[int]], rays: Sequence[float]
) -> float | None:
    kind, number, direction = parts
    if number is None:
        return direction
    siblings = numbers[kind]
    if sorted(siblings) != list(range(len(siblings))):
        return float(number)
    if len(siblings) == 1:
        return None
    return rays[number] if len(rays) == len(siblings) else 360 * number / len(siblings)
