"""What the drawing board takes for a mission: which of its parts are mappings, lists, numbers and points.

The engine alone decides what is right. A mission with mistakes is drawn as far as it can be; one with a list
in the place of a mapping, or a text in the place of a number, is not.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

Check: TypeAlias = Callable[[Any], bool]


def is_number(value: Any) -> bool:  # noqa: ANN401 - any plain value
    """Return whether a value is a number that JSON has."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_point(value: Any) -> bool:  # noqa: ANN401 - any plain value
    """Return whether a value lists two coordinates; lights have three."""
    return isinstance(value, list) and len(value) >= 2 and all(map(is_number, value))


def is_text(value: Any) -> bool:  # noqa: ANN401 - any plain value
    """Return whether a value is text."""
    return isinstance(value, str)


def is_plain(value: Any) -> bool:  # noqa: ANN401 - any plain value
    """Return whether JSON has a value: all numbers in it are finite."""
    if isinstance(value, Mapping):
        return all(map(is_plain, value.values()))
    if isinstance(value, list):
        return all(map(is_plain, value))
    return not isinstance(value, float) or math.isfinite(value)


def lists(check: Check) -> Check:
    """Return whether a value is a list of such items."""
    return lambda value: isinstance(value, list) and all(map(check, value))


def maps(check: Check) -> Check:
    """Return whether a value is a mapping to such values."""
    return lambda value: isinstance(value, Mapping) and all(map(check, value.values()))


def either(*checks: Check) -> Check:
    """Return whether a value is of one of some shapes."""
    return lambda value: any(check(value) for check in checks)


def has(needed: Mapping[str, Check], **optional: Check) -> Check:
    """Return whether a value is a mapping with keys of some shapes; optional ones may be missing, or null."""

    def check(value: Any) -> bool:  # noqa: ANN401 - any plain value
        return (
            isinstance(value, Mapping)
            and all(key in value and shape(value[key]) for key, shape in needed.items())
            and all(value.get(key) is None or shape(value[key]) for key, shape in optional.items())
        )

    return check


CIRCLE = has({"radius": is_number}, center=is_point)
RECTANGLE = has({"x": is_point, "y": is_point})
POLYGON = lists(is_point)
AREAS = has({}, disc=CIRCLE, rectangle=RECTANGLE)
WALLS = has(
    {}, rectangle=is_point, corners=POLYGON, sides=is_number, apothem=is_number,
    colors=lists(has({"side": is_number}, **{"from": is_number}, to=is_number)),
)  # fmt: skip
PARTS = lists(has({"kind": is_text}, angles=lists(is_number), points=POLYGON, range=is_number))
ROBOT = either(
    is_text,
    has({"preset": is_text}, drive=has({}), sensors=maps(has({})), battery=has({})),
    has({}, preset=lambda _: False, drive=has({}), sensors=PARTS, actuators=PARTS, battery=has({})),
)
MISSION = has(
    {"walls": WALLS},
    floor=has({}, patches=lists(has({}, circle=CIRCLE, rectangle=RECTANGLE, polygon=POLYGON))),
    start=AREAS,
    obstacles=lists(has({"center": is_point, "size": is_point}, angle=is_number)),
    objects=lists(has({}, center=is_point, size=is_point, radius=is_number, angle=is_number, start=AREAS)),
    lights=lists(has({"at": is_point}, intensity=is_number)),
    robots=either(is_number, lists(has({}, robot=ROBOT, count=is_number))),
    robot=ROBOT,
    metrics=maps(has({}, shape=has({}, circle=is_number, polygon=POLYGON, line=POLYGON, points=POLYGON))),
    fitness=either(is_text, has({}, offset=is_number, factors=maps(is_number))),
    failures=lists(has({})),
)


def is_drawable(mission: Any) -> bool:  # noqa: ANN401 - any plain value
    """Return whether the drawing board can show a mission, and change it by its tools."""
    return is_plain(mission) and MISSION(mission)
