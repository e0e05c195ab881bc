"""Experiments whose simulation is robots of a ROS system: what is refused, and how that is said."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.yaml import dump
from swarmwright.simulations import catalogue
from swarmwright.simulations.command.checking import parse_name
from swarmwright.simulations.command.ros_definition import RosOptions

TWIST, SCAN = "geometry_msgs/Twist", "sensor_msgs/LaserScan"
GOOD: dict[str, Any] = {
    "simulation": {
        "ros": 2,
        "robots": 2,
        "sensors": [{"sensor": "left", "topic": "scan", "type": SCAN, "sector": [-60, 0]}],
        "actuators": [{"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"}],
        "step": {"type": "simulation_interfaces/StepSimulation", "steps": 5},
        "reset": {"type": "simulation_interfaces/ResetSimulation", "scope": ["time", "state"]},
        "metrics": {"near": {"sensor": "left", "time": "min"}},
    },
    "fitness": "near",
    "controller": {"kind": "layered"},
}


def with_(**changes: Any) -> dict[str, Any]:
    """The experiment with other values of its simulation; None takes a key out."""
    values = copy.deepcopy(GOOD)
    for key, value in changes.items():
        place, name = values["simulation"], key
        while "__" in name:
            first, name = name.split("__", 1)
            place = place[int(first) if isinstance(place, list) else first]
        if value is None:
            del place[name]
        else:
            place[name] = value
    return values


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"ros": 3}, "simulation.ros: must be one of 1, 2, not 3"),
        ({"sensors__0__type": None}, "simulation.sensors[0].type: is missing"),
        ({"sensors__0__sektor": 1}, "simulation.sensors[0].sektor: unknown key; did you mean 'sector'?"),
        (
            {"sensors__0__type": "sensor_msgs/Imu"},
            "simulation.sensors[0].type: 'sensor_msgs/Imu' is not supported; expected sensor_msgs/",
        ),
        ({"sensors__0__sector": [0, -60]}, "sensors[0].sector: the first number must be below the second"),
        (
            {"actuators__0__field": "linear.w"},
            "simulation.actuators[0].field: 'linear.w' is not in geometry_msgs/Twist; expected angular.x,",
        ),
        (
            {"actuators__0__topic": "scan"},
            "actuators[0].type: scan has the type sensor_msgs/LaserScan at sensors[0]; a topic has a single",
        ),
        (
            {"actuators__0__topic": "cmd vel"},
            "actuators[0].topic: 'cmd vel' is not a topic: 'cmd vel' is not valid in a name: expected a",
        ),
        ({"actuators__0__topic": "cmd//vel"}, "'cmd//vel' is not a topic: contains // or ends with /"),
        ({"actuators__0__topic": "~/cmd"}, "'~/cmd' is not a topic: names that are private to a node are"),
        ({"sensors__0__topic": "/m/{robot}/1"}, "'/m/{robot}/1' is not a topic: '1' is not valid in a name"),
        (
            {
                "actuators": [
                    {"actuator": "a", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"},
                    {"actuator": "b", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"},
                ],
            },
            "simulation.actuators[1]: writes the same field as actuators[0] (a)",
        ),
        (
            {"robots": ["/"], "sensors__0__topic": "/model/{robot}/scan"},
            "simulation.sensors[0].topic: {robot} requires robots with names; write robots: [NAME, ..]",
        ),
        ({"actuators": None}, "simulation.actuators: is missing: controllers need sensors and actuators"),
        ({"step": None}, "simulation.step: is missing"),
        ({"step": {}}, "simulation.step.duration: write either the duration of a step or a service that"),
        ({"step": {"service": "/go", "steps": 3}}, "step.steps: only possible with simulation_interfaces"),
        ({"step": -1}, "simulation.step.duration: must be greater than 0, not -1"),
        ({"ros": 1}, "simulation.step.type: simulation_interfaces/StepSimulation requires ROS 2"),
        ({"reset__scope": "pose"}, "simulation.reset.scope: must be one of default, time, state, spawned"),
        ({"robots": ["a", "a"]}, "simulation.robots: a is repeated"),
        ({"robots": [""]}, "simulation.robots: '' is not a namespace; expected such as robot_1"),
        ({"robots": ["1st"]}, "simulation.robots: '1st' is not a namespace: '1st' is not valid"),
        ({"step": "fast"}, "simulation.step: must be seconds, such as 0.1, or {service: /step}, not 'fast'"),
        ({"robots": 0}, "simulation.robots: must be at least 1 and at most 1,000, not 0"),
        ({"robots": 500_000_000}, "simulation.robots: must be at least 1 and at most 1,000, not 500000000"),
        ({"robots": [f"r{one}" for one in range(1001)]}, "simulation.robots: must be at most 1,000"),
        ({"robots": []}, "simulation.robots: must be a number of robots, or a list of namespaces, not []"),
        ({"middleware": "rospy"}, "simulation.middleware: rospy is not for ROS 2; write dds or rclpy"),
        ({"metrics__near__sensor": "lift"}, "metrics.near.sensor: there is no sensor 'lift'; did you mean"),
        ({"metrics__near__time": "average"}, "simulation.metrics.near.time: must be one of last, first,"),
        ({"metrics__near__topic": "scan"}, "metrics.near.topic: write a topic, a sensor, or type: sim"),
        ({"done": "near <"}, "simulation.done: 'near <' is not a valid expression: invalid syntax"),
        ({"done": "far < 1"}, "simulation.done: 'far' is not a metric; available: near"),
        (
            {"spawn": {"uri": "rover", "poses": [{"x": 1}]}},
            "simulation.spawn.poses: must have a pose for each of the 2 robots, not 1",
        ),
        ({"spawn": {"uri": "rover"}}, "simulation.spawn.poses: write either poses, with a pose"),
        ({"spawn": {"file": "no.sdf", "poses": [{}, {}]}}, "simulation.spawn.file: no.sdf: there is no"),
        ({"environment": {"A": "{seed}"}}, "simulation.environment.A: {seed} is not a placeholder"),
    ],
    ids=str,
)  # fmt: skip
def test_a_mistake_is_reported_with_its_line(changes: dict[str, Any], expected: str, tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(dump(with_(**changes)), "utf-8")
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    said = str(caught.value).splitlines()[0]
    assert expected in said
    assert said.startswith(f"{file}:")


def test_several_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(dump(with_(robots=0, done="near <", sensors__0__type=None)), "utf-8")
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    assert len(str(caught.value).splitlines()) >= 2


def test_a_mistake_of_a_sensor_hides_none_of_actuators() -> None:
    twice = [{"actuator": name, "topic": "c", "type": TWIST, "field": "linear.x"} for name in ("a", "b")]
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping(with_(sensors__0__sector=[0, -60], actuators=twice))
    assert "sensors[0].sector" in str(caught.value)
    assert "actuators[1]: writes the same field" in str(caught.value)


@pytest.mark.parametrize("robots", [["_hidden"], ["a/b"], ["/a"], ["/"], ["a/"]])
def test_namespaces_are_those_of_ros(robots: list[str]) -> None:
    definition = parse_name(Experiment.from_mapping(with_(robots=robots)).simulation)
    assert isinstance(definition, RosOptions)
    assert definition.robots == robots


def test_fitness_is_needed() -> None:
    values = with_()
    del values["fitness"]
    with pytest.raises(InputError, match="fitness: is missing; write an expression over the metrics"):
        Experiment.from_mapping(values)


def test_parameters_need_a_way_to_the_simulation() -> None:
    values = {**with_(), "parameters": {"width": 5}}
    with pytest.raises(InputError, match=r"parameters.width: does not reach the simulation; .*reset.p"):
        Experiment.from_mapping(values)
    values["simulation"]["reset"]["command"] = ["./reset", "{width}"]
    assert Experiment.from_mapping(values).parameters["width"] == 5


def test_robots_that_are_there_have_one_server() -> None:
    assert Experiment.from_mapping(with_()).servers == 1
    for servers in (2, "local"):
        with pytest.raises(InputError, match="servers: only one server can drive the robots; write"):
            Experiment.from_mapping({**with_(), "servers": servers})
    assert Experiment.from_mapping({**with_(start="./simulator"), "servers": 2}).servers == 2
    own = {"ROS_MASTER_URI": "http://localhost:1131{instance}"}
    assert Experiment.from_mapping({**with_(environment=own), "servers": 2}).servers == 2


def test_a_definition_survives_its_name_and_the_experiment_file(tmp_path: Path) -> None:
    first = Experiment.from_mapping(with_())
    first.save(tmp_path / "saved.yaml")
    again = Experiment.load(tmp_path / "saved.yaml")
    assert again.to_mapping()["simulation"].keys() == first.to_mapping()["simulation"].keys()
    definition = parse_name(first.simulation)
    assert isinstance(definition, RosOptions)
    assert definition.name == first.simulation
    assert definition.robots == ["robot_1", "robot_2"]
    assert SimulationName.parse(first.simulation).label == "ros2"


def test_the_title_is_of_the_definition_and_its_files(tmp_path: Path) -> None:
    (tmp_path / "sim.py").write_text("one")
    values = with_(start="python3 sim.py")
    values["simulation"]["folder"] = str(tmp_path)
    name = Experiment.from_mapping(values).simulation
    first = catalogue.title(name)
    assert first.startswith("ros2@")
    (tmp_path / "sim.py").write_text("two")
    assert catalogue.title(name) != first
    assert catalogue.description(name)["sensor_names"] == ["left"]
    other = with_(start="python3 sim.py", steps=5)
    other["simulation"]["folder"] = str(tmp_path)
    assert catalogue.title(Experiment.from_mapping(other).simulation) != catalogue.title(name)


def test_what_the_program_reads_is_plain_and_complete() -> None:
    definition = parse_name(Experiment.from_mapping(with_(metrics__far={"sensor": "left"})).simulation)
    assert isinstance(definition, RosOptions)
    attachment = json.loads(json.dumps(definition.attachment()))
    assert attachment["step"]["service"] == "/step_simulation"
    assert attachment["reset"]["scope"] == 3
    assert attachment["reset"]["settle"] == 1
    assert not attachment["reset"]["despawns"]
    assert attachment["metrics"]["near"]["robots"] == "mean"


def test_steps_of_a_duration_are_not_repeatable() -> None:
    name = Experiment.from_mapping(with_(step=0.1)).simulation
    assert catalogue.description(name)["determinism"] == "none"


def test_the_duration_of_a_step_is_known() -> None:
    timed = Experiment.from_mapping(with_(step=0.2, reset={})).simulation
    assert catalogue.step_seconds(timed) == 0.2
    assert catalogue.step_seconds(Experiment.from_mapping(with_()).simulation) is None
