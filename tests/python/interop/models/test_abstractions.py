"""Abstraction descriptions: names and numbers of sensors and actuators."""

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError
from swarmwright.interop import models
from tests.python.interop.models.conftest import Edited
from tests.python.interop.models.test_behaviour import WALK

Edit = tuple[tuple[str | int, ...], Any]


def field(name: str, kind: str = "float64") -> dict[str, str]:
    return {"class": kind, "name": name}


def message(topic: str, *fields: dict[str, str]) -> dict[str, Any]:
    return {"topic": topic, "msg_def": {"class": "cpswarm_msgs/Any", "fields": list(fields)}}


def component(name: str, category: str, way: str, *messages: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, "description": "", "category": category, "api": {way: list(messages)}}


HEADER = field("header", "std_msgs/Header")
ADF: dict[str, Any] = {
    "runtime-env": "ROS",
    "sensors/actuators": [
        component("goal", "Sensor", "outputs", message("goal", HEADER, field("x"), field("y"))),
        component("defender", "Sensor", "outputs", message("defender", field("x"), field("y"))),
        component("heading", "Actuator", "inputs", message("heading", field("data", "float32"))),
    ],
}  # fmt: skip


def written(folder: Path, *edits: Edit) -> Path:
    values = deepcopy(ADF)
    for path, value in edits:
        inside: Any = values
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = value
    path_ = folder / "abstraction.json"
    path_.write_text(json.dumps(values, indent="\t"))
    return path_


def test_a_simulation_that_is_not_built_in_gets_sensors_and_actuators(edited: Edited, tmp_path: Path) -> None:
    walk = tmp_path / "walk.scxml"
    walk.write_text(WALK)
    problem = edited("problem.xml", ("minisim.Minisim", "a.Coverage"))
    experiment = models.load([written(tmp_path), problem, walk], target=tmp_path / "x.yaml").experiment
    assert (experiment.sensors, experiment.actuators) == (4, 1)
    controller = experiment.controller.model_dump()
    assert [entry != 1 for entry in controller["levels"]] == [False, False, True, False]


def test_all_five_files_are_an_experiment(drawn: list[Path], tmp_path: Path) -> None:
    walk = tmp_path / "walk.scxml"
    walk.write_text(WALK)
    paths = [*drawn, walk, written(tmp_path)]
    assert models.load(paths, target=tmp_path / "x.yaml").experiment.controller.kind == "parameter_set"


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("geometry_msgs/Point", ["s.f.x", "s.f.y", "s.f.z"]),
        ("geometry_msgs/Pose2D", ["s.f.x", "s.f.y", "s.f.theta"]),
        ("float32[2]", ["s.f[0]", "s.f[1]"]),
        ("bool", ["s"]),
        ("std_msgs/Float64", ["s"]),
    ],
)
def test_numbers_of_messages(tmp_path: Path, kind: str, names: list[str]) -> None:
    from swarmwright.interop.models._files import load

    sensor = component("s", "Sensor", "outputs", message("t", field("f", kind), field("name", "string")))
    part = load(written(tmp_path, (("sensors/actuators",), [sensor])))
    assert (part.sensor_names, part.sensors, part.actuators) == (names, len(names), None)


FIELD = ("sensors/actuators", 1, "api", "outputs", 0, "msg_def", "fields", 0, "class")


@pytest.mark.parametrize(
    ("edit", "answer"),
    [
        ((("runtime-env",), "YARP"), "json:2: runtime-env: 'YARP' found, expected ROS"),
        ((("sensors/actuators",), {}), "expected a list, not"),
        ((("sensors/actuators", 0), 1), "expected an object with name, category and api"),
        ((("sensors/actuators", 0, "name"), ""), "name is missing"),
        ((("sensors/actuators", 0, "name"), "defender"), "duplicate name 'defender'"),
        (
            (("sensors/actuators", 0, "category"), "sensor"),
            "'sensor' found, expected .*did you mean 'Sensor'",
        ),
        ((("sensors/actuators", 0, "api"), None), "api: expected an object with inputs or outputs"),
        ((("sensors/actuators", 0, "api"), {}), "the outputs of the sensor goal have no numbers"),
        ((("sensors/actuators", 2, "api"), {}), "the inputs of the actuator heading have no numbers"),
        ((FIELD, "sensor_msgs/Image"), "'sensor_msgs/Image' is neither a number nor a known message"),
        ((FIELD, "float32[]"), r"'float32\[\]' found, expected an array of 1 to 1000 numbers"),
        ((FIELD, "float32[999999]"), "expected an array of 1 to 1000 numbers"),
        ((FIELD[:-1], 3), "expected an object with class and name"),
        ((("sensor",), 3), "unknown key"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, edit: Edit, answer: str) -> None:
    with pytest.raises(InputError, match=answer):
        models.load([written(tmp_path, edit)], simulation="minisim")


def test_other_numbers_than_the_simulations_are_refused(edited: Edited, tmp_path: Path) -> None:
    path = written(tmp_path, (("sensors/actuators", 1, "name"), "goal2"))
    assert models.load([path], simulation="minisim").experiment.simulation == "minisim"
    with pytest.raises(InputError, match=r"abstraction\.json: has 4 sensors, but emergency_exit has 10"):
        models.load([path], simulation="emergency_exit")
    with pytest.raises(InputError, match=r"problem\.xml: has 3 sensors, but .*abstraction\.json has 4"):
        models.load([path, edited("problem.xml", ('value="4"', 'value="3"'))])
