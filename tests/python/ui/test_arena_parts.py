"""What the drawing board offers is what the engine takes, no less and no more."""

import re
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Episodes, InputError
from swarmwright.common import yaml
from swarmwright.ui import arena_parts
from swarmwright.ui.views.draw import experiment, problems

ENGINE = Path(__file__).parents[3] / "engine" / "worlds" / "arena" / "src"
MISSION: dict[str, Any] = {
    "walls": {"rectangle": [3, 3]},
    "objects": [{"name": "box", "size": [0.1, 0.1], "mass": 0.1, "center": [1, 1]}],
    "floor": {
        "patches": [
            {"name": "zone", "rectangle": {"x": [-1, -0.5], "y": [0, 0.5]}, "color": "black"},
            {"name": "spot", "circle": {"center": [0.5, 0], "radius": 0.2}, "color": "white"},
        ]
    },
    "start": {"disc": {"radius": 0.5}},
    "robots": 3,
    "duration": 1,
    "fitness": "order",
}
ROBOT: dict[str, Any] = {
    "radius": 0.035,
    "drive": {"kind": "differential", "wheel_base": 0.05, "max_speed": 0.1},
}


def first_values(fields: dict[str, Any], *, all_of: bool = False) -> dict[str, Any]:
    """Return values as the form fills them in: of required fields, or `all_of` them."""
    values: dict[str, Any] = {}
    for name, spec in fields.items():
        if spec.get("is_optional") and (not all_of or spec.get("value") is None):
            continue
        match spec["type"]:
            case "patch":
                values[name] = "zone"
            case "patches":
                values[name] = ["zone"]
            case "object" | "kind":
                continue
            case _:
                values[name] = spec["value"]
    return values


SIDES: dict[str, Any] = {
    "robots": [
        {"name": name, "count": 1, "robot": {**ROBOT, "sensors": [{"kind": "compass"}]}}
        for name in ("a", "b")
    ],
    "captures": [{"robots": "a", "by": "b", "reach": 0.01}],
    "flags": [
        {"name": "f", "base": "zone", "robots": "a", "home": "spot", "lost_to": "b", "reach": 0.01},
    ],
}
"""What metrics of sides need."""


def refusal(mission: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        experiment(mission, Path())
    return str(caught.value)


def expected_names(message: str) -> set[str]:
    """Return the names that a refusal says are expected."""
    return set(re.findall(r'[`"](\w+)[`"]', message.partition("expected")[2]))


def with_metric(**metric: Any) -> dict[str, Any]:
    return {**MISSION, "metrics": {"m": metric}, "fitness": "m"}


def with_robot(**changes: Any) -> dict[str, Any]:
    return {**MISSION, "robot": {**ROBOT, "sensors": [{"kind": "compass"}], **changes}}


def test_every_kind_is_offered() -> None:
    assert expected_names(refusal(with_metric(kind="no_kind"))) == set(arena_parts.METRICS)
    assert expected_names(refusal(with_robot(sensors=[{"kind": "no_kind"}]))) == set(arena_parts.SENSORS)
    assert expected_names(refusal(with_robot(actuators=[{"kind": "no_kind"}]))) == set(arena_parts.ACTUATORS)
    assert expected_names(refusal(with_robot(drive={"kind": "no_kind"}))) == set(arena_parts.DRIVES)
    assert set(Episodes(experiment(MISSION, Path()), seeds=[1]).metrics) == set(arena_parts.GENERAL_METRICS)


@pytest.mark.parametrize("kind", arena_parts.METRICS)
def test_a_metric_has_these_fields_and_first_values(kind: str) -> None:
    fields = arena_parts.METRICS[kind]
    assert expected_names(refusal(with_metric(kind=kind, no_field=1))) == set(fields)
    values = first_values(fields)
    if kind == "time_until":
        values["at_least"] = fields["at_least"]["value"]
    if kind == "mean_distance_rim":
        values["patch"] = "spot"
    if kind == "chain_reach":
        values["to"] = "spot"
    if kind == "painted_share":
        values["robots"] = "a"
    sides = SIDES if kind in ("caught", "flags_brought", "flags_carried", "painted_share") else {}
    assert problems({**with_metric(kind=kind, **values), **sides}, Path()) == []


@pytest.mark.parametrize("kind", arena_parts.SENSORS)
def test_a_sensor_has_these_fields_and_first_values(kind: str) -> None:
    fields = arena_parts.SENSORS[kind]
    parts: dict[str, Any] = {"battery": {"standing": 120, "driving": 40}} if kind == "battery" else {}
    if kind == "gripper":
        parts = {"actuators": [{"kind": "gripper"}]}
    if fields:
        refused = expected_names(refusal(with_robot(sensors=[{"kind": kind, "no_field": 1}])))
        assert refused - {"radio"} == set(fields)
    for all_of in (False, True):
        values = {"kind": kind, **first_values(fields, all_of=all_of)}
        if "count" in fields:
            values["count"] = 8
        assert problems(with_robot(sensors=[values], **parts), Path()) == []


@pytest.mark.parametrize("kind", arena_parts.ACTUATORS)
def test_an_actuator_has_these_fields_and_first_values(kind: str) -> None:
    fields = arena_parts.ACTUATORS[kind]
    named = expected_names(refusal(with_robot(actuators=[{"kind": kind, "no_field": 1}])))
    assert named == set(fields)
    values = first_values(fields, all_of=True)
    heard = {
        "kind": "range_and_bearing",
        "range": 1,
        "gives": ["count", *(["message"] if kind == "message" else [])],
    }
    assert problems(with_robot(actuators=[{"kind": kind, **values}], sensors=[heard]), Path()) == []


@pytest.mark.parametrize("kind", arena_parts.DRIVES)
def test_a_drive_has_these_fields_and_first_values(kind: str) -> None:
    fields = arena_parts.DRIVES[kind]
    assert expected_names(refusal(with_robot(drive={"kind": kind, "no_field": 1}))) == set(fields)
    for all_of in (False, True):
        drive = {"kind": kind, **first_values(fields, all_of=all_of)}
        assert problems(with_robot(drive=drive), Path()) == []


@pytest.mark.parametrize("name", arena_parts.ROBOTS)
def test_a_built_in_robot_can_be_changed_into_an_own_one(name: str) -> None:
    description = arena_parts.ROBOTS[name]
    file = ENGINE / "robots" / f"{name}.yaml"
    if file.exists():
        assert yaml.read(file).values == description
    built_in = Episodes(experiment({**MISSION, "robot": name}, Path()), seeds=[1])
    own = Episodes(experiment({**MISSION, "robot": description}, Path()), seeds=[1])
    assert (own.sensors, own.actuators) == (built_in.sensors, built_in.actuators)
    assert own.scene().bodies[0].radius == built_in.scene().bodies[0].radius


def test_every_built_in_robot_is_described() -> None:
    names = re.search(r"\((.*?)\)", refusal({**MISSION, "robot": "nobody"}))
    assert names is not None
    assert names[1].split(", ") == list(arena_parts.ROBOTS)
