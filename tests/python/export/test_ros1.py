"""The package for ROS 1 without ROS; `tests/ros1` builds and runs it."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml

from swarmwright import InputError
from swarmwright.export import EXPORTERS
from swarmwright.export import subject as subject_module
from swarmwright.export.exporting import write
from swarmwright.export.ros import Ros1
from swarmwright.export.subject import Subject
from swarmwright.export.verification import verify
from swarmwright.simulations.command.ros_definition import RosOptions
from swarmwright.simulations.ros.mapping import read_mapping
from tests.python.export.specifications import network

SUBJECT = Subject(
    network("fully_meshed", "tanh", [-1.0, 1.0]),
    (("Run", "robots"),),
    {
        "sensor_names": ["goal x", "goal", "goal"],
        "actuator_names": ["N", "on"],
        "sensor_units": ["m", "m", ""],
    },
)


def test_the_package_has_the_controller_and_its_names() -> None:
    assert isinstance(EXPORTERS.get("ros1")(), Ros1)
    files = {name: str(content) for name, content in Ros1().files(SUBJECT, "Rover").items()}
    assert ET.fromstring(files["package.xml"]).findtext("name") == "rover"
    assert "project(rover LANGUAGES C CXX)" in files["CMakeLists.txt"]
    assert '#include "Rover.c"' in files["src/exported.c"]
    node = ET.fromstring(files["launch/controller.launch"]).find("group/node")
    assert node is not None
    assert (node.get("pkg"), node.get("type")) == ("rover", "swarmwright_controller")
    # Without it, what an earlier mapping had would remain on the parameter server.
    assert node.get("clear_params") == "true"
    mapping = yaml.safe_load(files["config/mapping.template.yaml"])
    # Names that YAML takes for truth values are text, and the same name twice is told apart.
    assert [entry["sensor"] for entry in mapping["sensors"]] == ["goal x", "goal 1", "goal 2"]
    assert [entry["actuator"] for entry in mapping["actuators"]] == ["N", "on"]
    for name in ("goal x", "goal 1", "goal 2", "N", "on"):
        assert f'    "{name}",' in files["src/exported.c"]
    assert not [name for name, content in files.items() if "@" in content and name != "package.xml"]


@pytest.mark.slow
def test_the_controller_in_the_package_has_the_same_bits() -> None:
    found = verify(Ros1(), SUBJECT, "rover", Ros1().files(SUBJECT, "rover"))
    assert found.ok
    assert found.differing == 0


def test_what_cannot_be_a_package_is_refused() -> None:
    with pytest.raises(InputError, match="a parameter set steers no robot"):
        Ros1().files(Subject({"kind": "parameter_set", "parameters": {}}, values={"a": 1}), "rover")
    with pytest.raises(InputError, match="'exported' is a file of the package"):
        Ros1().files(SUBJECT, "exported")
    for prefix in ("std_msgs", "Roscpp", "catkin", "roslaunch"):
        with pytest.raises(InputError, match=f"'{prefix}' is a dependency of the package"):
            Ros1().files(SUBJECT, prefix)


def test_it_is_written_again_beside_an_own_mapping(tmp_path: Path) -> None:
    files = Ros1().files(SUBJECT, "rover")
    write(files, tmp_path)
    own = tmp_path / "config" / "mapping.yaml"
    own.write_text("rate: 5\n", encoding="utf-8")
    write(files, tmp_path)
    assert own.read_text(encoding="utf-8") == "rate: 5\n"


def template(subject: Subject) -> tuple[dict[str, Any], str]:
    text = str(Ros1().files(subject, "rover")["config/mapping.template.yaml"])
    return yaml.safe_load(text), text


@pytest.mark.parametrize(("step", "rate"), [(0.1, 10), (0.25, 4), (0.03, 33.3333333), (1e-8, 1e8)])
def test_the_rate_is_that_of_the_simulation(step: float, rate: float) -> None:
    mapping, text = template(replace(SUBJECT, step_size=step))
    assert mapping["rate"] == pytest.approx(rate, rel=1e-8)
    assert "as many as in the simulation" in text
    assert " guess" not in text


def test_a_rate_that_is_not_known_is_called_a_guess() -> None:
    mapping, text = template(SUBJECT)
    assert mapping["rate"] == 10
    assert "10 is a guess" in text


def test_names_of_any_length_leave_the_template_valid() -> None:
    names = ["x" * length for length in range(14, 18)]
    for name in names:
        mapping, _ = template(replace(SUBJECT, description={"sensor_names": ["a", "b", name]}))
        assert mapping["sensors"][2]["sensor"] == name


def test_a_random_sensor_needs_no_topic_and_wheels_have_an_example() -> None:
    description = {
        "sensor_names": ["a", "b", "random"],
        "actuator_names": ["left wheel", "right wheel"],
    }
    mapping, text = template(replace(SUBJECT, description=description))
    assert mapping["sensors"][2] == {"sensor": "random", "source": "random"}
    # With the example instead of the two entries above, and topics, it is a mapping.
    begin, _, end = text.partition("actuators:\n  - ")
    example = "\n".join(line[1:] for line in end.splitlines() if line.startswith("#  "))
    filled = yaml.safe_load(f"{begin}actuators:\n{example}\n")
    for entry in filled["sensors"][:2]:
        entry.update(topic="x", type="std_msgs/Float32", field="data")
    read = read_mapping(filled, description["sensor_names"], description["actuator_names"])
    straight, turning = ([sum(w * v[i] for i, w in one.terms) * one.scale for one in read.actuators]
                         for v in ((1.0, 1.0), (-1.0, 1.0)))  # fmt: skip
    assert straight == pytest.approx([0.12, 0.0])
    assert turning == pytest.approx([0.0, 2 * 0.12 / 0.053], rel=1e-5)


def test_wheels_are_those_of_the_run() -> None:
    description = {"actuator_names": ["left wheel", "right wheel"]}
    _, text = template(replace(SUBJECT, description=description, wheels=(0.3, 0.14)))
    assert "0.3 m/s for 1 and 0.14 m" in text
    assert "e-puck" not in text
    assert "#    scale: 2.14286" in text


def test_topics_on_which_a_controller_was_evolved_are_in_the_mapping() -> None:
    entries = [
        {"sensor": "goal x", "topic": "goal", "type": "geometry_msgs/Twist", "field": "linear.x"},
        {"sensor": "goal 1", "topic": "light", "type": "std_msgs/Float32", "scale": 0.5},
    ]
    known = {"sensors": entries, "actuators": [], "rate": 20.0}
    subject = replace(SUBJECT, topics=known)
    mapping = yaml.safe_load(str(Ros1().files(subject, "rover")["config/mapping.template.yaml"]))
    assert mapping["rate"] == 20
    assert mapping["sensors"][:2] == entries
    assert mapping["sensors"][2] == {"sensor": "goal 2", "topic": "", "type": "", "field": ""}


def test_topics_named_after_robots_leave_the_rest_of_their_entries() -> None:
    definition = RosOptions.model_validate(
        {
            "ros": 1,
            "robots": 2,
            "sensors": [{"sensor": "goal x", "topic": "goal", "type": "std_msgs/Float32", "timeout": 2.0}],
            "actuators": [
                {
                    "actuator": "N",
                    "topic": "/model/{robot}/cmd_vel",
                    "type": "geometry_msgs/Twist",
                    "field": "linear.x",
                    "scale": 0.2,
                    "limits": [0.0, 0.2],
                }
            ],
            "step": 0.1,
        }
    )
    topics, real_time = subject_module._ros_topics(definition.name)
    assert real_time
    mapping, text = template(replace(SUBJECT, topics=topics))
    assert mapping["rate"] == pytest.approx(10)
    assert mapping["sensors"][0] == definition.topics["sensors"][0]
    # Limits keep a robot safe: they must not be lost with a name that the mapping cannot have.
    assert mapping["actuators"][0] == {**definition.topics["actuators"][0], "topic": ""}
    assert 'topic: ""  # in the run: "/model/{robot}/cmd_vel"' in text
    assert "Fill in those that are empty" in text
