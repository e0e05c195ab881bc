"""Parts of missions of the arena: kinds of metrics, sensors, actuators and drives, with first values.

`docs/reference/arena.md` explains them. The engine alone decides what is right; these tables say what forms
offer, and tests hold them against it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

GENERAL_METRICS = (
    "order",
    "speed",
    "group_speed",
    "distance_to_center",
    "nearest_distance",
    "largest_group",
)
"""Every mission has these, at the end of the episode, without listing them."""
COLORS = ("red", "green", "blue", "cyan", "magenta", "yellow")
WHEN = ("each_tick", "mean", "end")


def number(value: float | None = None, unit: str = "", *, is_optional: bool = False) -> dict[str, Any]:
    """Return a field for a number; without a value it has to be asked for."""
    return {"type": "number", "value": value, "unit": unit, "is_optional": is_optional}


def choice(options: Sequence[str], value: str) -> dict[str, Any]:
    """Return a field for one of some names; `value` is the engine's default, which needs no key."""
    return {"type": "choice", "options": list(options), "value": value, "is_optional": True}


def several(options: Sequence[str], value: Sequence[str], *, is_optional: bool = False) -> dict[str, Any]:
    """Return a field for some of some names."""
    return {"type": "several", "options": list(options), "value": list(value), "is_optional": is_optional}


def reference(kind: str, *, is_optional: bool = False) -> dict[str, Any]:
    """Return a field for the name of a `patch`, `object` or `kind` of robots, or for some `patches`."""
    return {"type": kind, "is_optional": is_optional}


SHARE = {"type": "flag", "value": False, "is_optional": True}
NAME = {"type": "text", "is_optional": True}
METERS = "m"


def _sum(**fields: Mapping[str, Any]) -> dict[str, Any]:
    return {**fields, "when": choice(WHEN, "each_tick"), "share": SHARE}


def _mean(**fields: Mapping[str, Any]) -> dict[str, Any]:
    return {**fields, "when": choice(WHEN, "mean")}


METRICS: dict[str, dict[str, Any]] = {
    "robots_on": _sum(patch=reference("patch"), robots=reference("kind", is_optional=True)),
    "most_robots_on": _sum(patches=reference("patches")),
    "returns": {"sources": reference("patches"), "nest": reference("patch")},
    "time_until": {
        "patch": reference("patch"),
        "at_least": number(1, is_optional=True),
        "at_most": number(None, is_optional=True),
    },
    "crossings_south": {"patch": reference("patch")},
    "objects_on": _sum(patch=reference("patch"), object=reference("object", is_optional=True)),
    "objects_held": _sum(object=reference("object", is_optional=True)),
    "object_distance": _mean(patch=reference("patch"), object=reference("object", is_optional=True)),
    "largest_group": {**_mean(link=number(0.35, METERS)), "share": SHARE},
    "groups": _mean(link=number(0.35, METERS)),
    "order": _mean(),
    "speed": _mean(),
    "group_speed": _mean(link=number(None, METERS, is_optional=True)),
    "distance_to_center": _mean(),
    "nearest_distance": _mean(),
    "covered_share": _mean(radius=number(0.25, METERS)),
    "visited_share": {"cell": number(0.1, METERS)},
    "cell_age": {"side": number(2, METERS), "cells": number(10)},
    "shape_deviation": _mean(shape={"type": "shape", "value": {"circle": 0.5}}),
    "chain_reach": _mean(**{"from": reference("patch"), "to": reference("patch")}, link=number(0.3, METERS)),
    "largest_group_area": {
        "link": number(0.35, METERS),
        "disc": number(0.25, METERS),
        "within": number(1.2, METERS),
    },
    "mean_distance": {
        "radius": number(1.2, METERS),
        "most": number(2.5, METERS),
        "outside": reference("patches", is_optional=True),
    },
    "mean_distance_inside": {"patch": reference("patch"), "most": number(1, METERS)},
    "mean_distance_rim": {
        "patch": reference("patch"),
        "near": number(0.05, METERS),
        "most": number(1, METERS),
    },
    "sum": {"offset": number(0, is_optional=True), "factors": {"type": "factors", "value": {}}},
    "caught": _sum(robots=reference("kind", is_optional=True)),
    "flags_brought": {"flag": NAME},
    "flags_carried": _mean(flag=NAME),
    "painted_share": _mean(robots=reference("kind"), cell=number(0.1, METERS)),
    "robots_in_wrong_half": {"patch": reference("patch")},
    "stop_errors": {"patch": reference("patch")},
}
"""Fields of each kind of metric, those that are used most first."""

NOISE = number(0, is_optional=True)
DIRECTIONS = {
    "count": number(8, is_optional=True),
    "angles": {"type": "numbers", "unit": "°", "is_optional": True},
}

SENSORS: dict[str, dict[str, Any]] = {
    "proximity": {
        **DIRECTIONS,
        "range": number(0.1, METERS),
        "noise": NOISE,
        "response": {"type": "numbers", "is_optional": True},
        "gives": choice(("values", "vector"), "values"),
    },
    "light": {
        **DIRECTIONS,
        "reach": number(2.5, METERS, is_optional=True),
        "noise": NOISE,
        "gives": choice(("values", "vector"), "values"),
    },
    "ground": {
        "points": {"type": "points", "unit": METERS, "is_optional": True},
        "noise": NOISE,
        "gives": choice(("values", "color"), "values"),
    },
    "range_and_bearing": {
        "range": number(0.7, METERS),
        "loss": number(0, is_optional=True),
        "gives": several(
            ("count", "squashed", "attraction", "sectors", "message"),
            ("count", "attraction"),
            is_optional=True,
        ),
    },
    "neighbours": {
        "range": number(1, METERS),
        "gives": several(("count", "center", "heading", "nearest"), ("count", "center"), is_optional=True),
    },
    "camera": {
        "range": number(0.5, METERS),
        "noise": number(0, "°", is_optional=True),
        "colors": several(COLORS, ("red",)),
        "gives": several(
            ("count", "seen", "attraction", "direction", "sectors"), ("count", "attraction"), is_optional=True
        ),
    },
    "encoders": {"noise": NOISE},
    "compass": {"noise": number(0, "°", is_optional=True)},
    "random": {},
    "battery": {"noise": NOISE},
    "gripper": {},
    "flag": {},
}

ACTUATORS: dict[str, dict[str, Any]] = {
    "led": {"colors": several(COLORS, ("red",))},
    "gripper": {"reach": number(0.01, METERS, is_optional=True)},
    "message": {"numbers": number(1)},
}

_DRIVE = {
    "max_speed": number(0.12, "m/s"),
    "acceleration": number(3.75, "m/s²", is_optional=True),
    "noise": NOISE,
}
DRIVES: dict[str, dict[str, Any]] = {
    "differential": {"wheel_base": number(0.053, METERS), **_DRIVE},
    "holonomic": {**_DRIVE, "max_turn": number(180, "°/s")},
    "car": {"wheel_base": number(0.06, METERS), **_DRIVE, "max_steering": number(30, "°")},
}

BODY: dict[str, Any] = {
    "radius": number(0.035, METERS),
    "height": number(None, METERS, is_optional=True),
    "mass": number(0.4, "kg", is_optional=True),
}

_E_PUCK_ANGLES = [17, 50, 90, 150, 210, 270, 310, 343]


def _e_puck(*, is_processed: bool) -> dict[str, Any]:
    """Return the e-puck of RM1.1, or of RM1.2 with its processed values, as a description of an own robot."""
    form = {"gives": "vector"} if is_processed else {}
    ground = {"gives": "color"} if is_processed else {}
    heard = ["count", "attraction"] if is_processed else ["squashed", "sectors"]
    points = [[0.03, 0]] if is_processed else [[0.03, -0.009], [0.03, 0], [0.03, 0.009]]
    return {
        "radius": 0.035,
        "height": 0.076,
        "drive": {"kind": "differential", "wheel_base": 0.053, "max_speed": 0.12, "noise": 0.05},
        "sensors": [
            {
                "kind": "proximity",
                "angles": [11.25 + 45 * index for index in range(8)],
                "range": 0.05,
                "noise": 0.05,
                **form,
            },
            {"kind": "light", "angles": _E_PUCK_ANGLES, "noise": 0.05, **form},
            {"kind": "ground", "points": points, "noise": 0.05, **ground},
            {"kind": "range_and_bearing", "range": 0.7, "loss": 0.85, "gives": heard},
            *([{"kind": "random"}] if is_processed else []),
        ],
    }


ROBOTS: dict[str, dict[str, Any]] = {
    "e-puck-rm1.1": _e_puck(is_processed=False),
    "e-puck-rm1.2": _e_puck(is_processed=True),
    "foot-bot": {
        "radius": 0.085036758,
        "height": 0.146899733,
        "mass": 1.6,
        "drive": {
            "kind": "differential",
            "wheel_base": 0.14,
            "max_speed": 0.3,
            "acceleration": 3.75,
            "noise": 0.05,
        },
        "sensors": [
            {"kind": "proximity", "count": 24, "range": 0.1, "noise": 0.05},
            {"kind": "light", "count": 24, "noise": 0.05},
            {
                "kind": "ground",
                "points": [[0.063, 0.0116], [-0.063, 0.0116], [-0.063, -0.0116], [0.063, -0.0116]],
                "noise": 0.05,
            },
            {"kind": "range_and_bearing", "range": 3, "gives": ["squashed", "sectors"]},
        ],
    },
    "kilobot": {
        "radius": 0.0165,
        "height": 0.034,
        "mass": 0.024,
        "drive": {
            "kind": "differential",
            "wheel_base": 0.0255,
            "max_speed": 0.01,
            "acceleration": 1,
            "noise": 0.1,
        },
        "sensors": [
            {"kind": "light", "count": 1, "noise": 0.05},
            {"kind": "range_and_bearing", "range": 0.1, "loss": 0.1, "gives": ["count", "message"]},
            {"kind": "random"},
        ],
        "actuators": [{"kind": "message", "numbers": 1}],
    },
    "point": {
        "radius": 0.01,
        "drive": {"kind": "holonomic", "max_speed": 0.2, "max_turn": 180, "acceleration": 10},
        "sensors": [
            {"kind": "neighbours", "range": 1, "gives": ["count", "center", "heading", "nearest"]},
            {"kind": "compass"},
        ],
    },
    "turtlebot3": {
        "radius": 0.105,
        "height": 0.192,
        "mass": 1,
        "drive": {
            "kind": "differential",
            "wheel_base": 0.16,
            "max_speed": 0.22,
            "acceleration": 2.5,
            "noise": 0.02,
        },
        "sensors": [
            {"kind": "proximity", "count": 36, "range": 3.5, "noise": 0.01},
            {"kind": "encoders"},
            {"kind": "compass", "noise": 2},
        ],
    },
}
"""The built-in robots as descriptions to draw them, and to start an own robot from.

Those of the e-pucks are close, not equal: the engine's rays begin 1 mm from the rim, and their responses and
grey values are measured on real robots.
"""

PARTS = {
    "metrics": METRICS,
    "general_metrics": GENERAL_METRICS,
    "sensors": SENSORS,
    "actuators": ACTUATORS,
    "drives": DRIVES,
    "body": BODY,
    "robots": ROBOTS,
    "colors": COLORS,
}
"""All of it, as the drawing board reads it."""
