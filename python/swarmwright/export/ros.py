"""Packages for ROS 1 (`--to ros1`) and ROS 2 (`--to ros2`): the controller, nodes, and a mapping."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.untrusted import escape_json, escape_line
from swarmwright.controllers.kinds import describe_controller
from swarmwright.controllers.source.text import MARK, c_literal, quote_python
from swarmwright.experiment.robots import DEFAULT
from swarmwright.export._base import Exporter, Files, format_facts, render
from swarmwright.export.c import C
from swarmwright.export.python import Python
from swarmwright.export.python_modules import copy_of, has_user_modules
from swarmwright.export.sequences import Sequences, measure_difference
from swarmwright.export.subject import PRESETS, RANDOM, Channel, Subject

_SHARED = (
    "control.cpp",
    "control.hpp",
    "exported.h",
    "mapping.cpp",
    "mapping.hpp",
    "topics.cpp",
    "topics.hpp",
    "value.hpp",
)
"""Sources shared by all controllers, ROS 1 and ROS 2."""
_DEPENDENCY = re.compile(r"depend>(\w+)</")
_ROBOT = "{robot}"
"""Placeholder of a robot's name in topics of a run."""
_RESERVED_NAME = "exported"
"""Name of a file of the package."""
_SCALING = """\
# Where a comment below has a range, -1 to 1 for LOW to HIGH, scale and offset convert between it and -1 to 1:
# change them where the topic has another unit.
#"""


_WHEELS = ["left wheel", "right wheel"]
_WHEELS_WORDS = """
# A robot that takes geometry_msgs/Twist needs these entries instead of the two above: the speed of the base
# is the mean of its wheels', its turn their difference by the distance between them. Here for the {robot},
# {speed:.6g} m/s for 1 and {base:.6g} m:"""


def values_of(subject: Subject, prefix: str) -> dict[str, str]:
    """Return the replacements for the templates.

    Raises InputError for a parameter set, which steers no robot, and for the prefix `exported`.
    """
    if not subject.steers:
        raise InputError(
            "controller: a parameter set steers no robot, so no node can run it; export its values with --to "
            "c"
        )
    if prefix.lower() == _RESERVED_NAME:
        raise InputError(f"prefix: {prefix!r} is a file of the package; choose another prefix")
    return {
        "mark": MARK,
        "p": prefix,
        "PREFIX": prefix.upper(),
        "package": prefix.lower(),
        "words": describe_controller(dict(subject.specification)),
        "facts": format_facts(subject),
        "sensor_names": _names(subject.sensors, c_literal),
        "actuator_names": _names(subject.actuators, c_literal),
        "python_sensor_names": _names(subject.sensors, quote_python),
        "python_actuator_names": _names(subject.actuators, quote_python),
    }


def check_package(prefix: str, manifest: str) -> None:
    """Raise InputError if the package has the name of one of its dependencies.

    Args:
        prefix: in lower case, the name of the package.
        manifest: the text of package.xml.
    """
    if prefix.lower() in _DEPENDENCY.findall(manifest):
        raise InputError(f"prefix: {prefix!r} is a dependency of the package; choose another prefix")


def sources(subject: Subject, prefix: str, values: dict[str, str]) -> Files:
    """Return the controller in C, and the sources of the C++ node shared by ROS 1 and ROS 2; in `src`."""
    code = C().files(subject, prefix)
    return {
        f"src/{prefix}.h": code[f"{prefix}.h"],
        f"src/{prefix}.c": code[f"{prefix}.c"],
        "src/exported.c": render("ros/src/exported.c", values),
        **{f"src/{name}": render(f"ros/src/{name}", values) for name in _SHARED},
    }


def mapping(subject: Subject) -> str:
    """Return a template of a mapping, with an entry for each sensor and actuator.

    For a controller that was evolved on ROS robots, it contains their topics.
    """
    step = subject.step_size
    rate = float(subject.topics.get("rate", 0)) or (1 / step if step else 0.0)
    words = "as many as in the simulation"
    if not rate:
        words = "10 is a guess, for the simulation names no duration of a step"
    return render(
        "ros/mapping.template.yaml",
        {
            "mark": MARK,
            "facts": format_facts(subject, "#   "),
            "begin": _begin(subject),
            "scaling": _SCALING if subject.conversion else "",
            "rate": _number(f"{rate or 10:.9g}").ljust(23),
            "rate_words": words,
            "wheels": _wheels(subject),
            "sensors": _entries("sensor", subject.sensors, subject.topics.get("sensors", ())),
            "actuators": _entries("actuator", subject.actuators, subject.topics.get("actuators", ())),
        },
    )


def _names(channels: Sequence[Channel], literal: Callable[[str], str]) -> str:
    return "\n".join(f"    {literal(channel.name)}," for channel in channels)


def _begin(subject: Subject) -> str:
    if subject.topics:
        words = (
            "Copy this to mapping.yaml and check it. Topics are those on which the controller was evolved."
        )
        entries = [*subject.topics.get("sensors", ()), *subject.topics.get("actuators", ())]
        if any(_ROBOT in entry["topic"] for entry in entries):
            words += f"\n# Fill in those that are empty: they were other ones for each robot, {_ROBOT}."
        return words
    return "Copy this to mapping.yaml and fill it in."


def _entries(kind: str, channels: Sequence[Channel], topics: Sequence[Mapping[str, Any]]) -> str:
    """Return entries; known topics of sensors and actuators are filled in."""
    by_name = {entry[kind]: entry for entry in topics}
    lines = []
    for channel in channels:
        name = channel.name
        begin = f"  - {kind}: {escape_json(json.dumps(name, ensure_ascii=False))}"
        unit = f"{escape_line(channel.unit)}, " if channel.unit else ""
        values = {"topic": "", "type": "", "field": "", **by_name.get(name, _scaling(kind, channel))}
        lines.append(f"{begin:<29} # {unit}{escape_line(channel.limits)}")
        if kind == "sensor" and name == RANDOM and channel.range is None and name not in by_name:
            lines.append("    source: random")
            continue
        for key, value in values.items():
            if key != kind and not (key == "field" and value == "" and name in by_name):
                lines.append(f"    {key}: {_format_value(key, value)}")
    return "\n".join(lines)


def _format_value(key: str, value: Any) -> str:  # noqa: ANN401 - of an entry
    """Format a value of an entry; topics that a node cannot resolve are empty."""
    if key == "topic" and _ROBOT in value:
        return f'""  # in the run: {escape_json(json.dumps(value, ensure_ascii=False))}'
    return _number(repr(value)) if isinstance(value, float) else json.dumps(value)


def _wheels(subject: Subject) -> str:
    """Return an example that converts the wheels of the arena's robots to a command of a base."""
    if [actuator.name for actuator in subject.actuators] != _WHEELS:
        return ""
    robot = "robot of the run"
    speed, base = subject.wheels
    if not speed or not base:
        e_puck = PRESETS[DEFAULT]
        robot, speed, base = "e-puck of the arena", e_puck.max_speed, e_puck.wheel_base
    names = [escape_json(json.dumps(name)) for name in _WHEELS]
    entries = []
    for field, weights, scale in (
        ("linear.x", ("0.5", "0.5"), speed),
        ("angular.z", ("-1", "1"), speed / base),
    ):
        shares = ", ".join(f"{name}: {weight}" for name, weight in zip(names, weights, strict=True))
        entries += [
            f"#  - actuators: {{{shares}}}",
            "#    topic: cmd_vel",
            "#    type: geometry_msgs/Twist",
            f"#    field: {field}",
            f"#    scale: {scale:.6g}",
        ]
    return "\n".join([_WHEELS_WORDS.format(robot=robot, speed=speed, base=base), *entries])


def _scaling(kind: str, channel: Channel) -> dict[str, float]:
    """Return scale and offset of a sensor or actuator that the simulation scales, in its unit."""
    if channel.range is None:
        return {}
    scale, offset = channel.range.from_value if kind == "sensor" else channel.range.to_value
    return {"scale": scale, "offset": offset + 0.0}


def _number(text: str) -> str:
    """Format a number for YAML 1.1, where an exponent needs a decimal point before it."""
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


_ROS1_TEMPLATES = (
    "package.xml",
    "CMakeLists.txt",
    "src/graph.hpp",
    "src/swarmwright_controller.cpp",
    "launch/controller.launch",
)
"""Templates of ROS 1 only."""


class Ros1(Exporter):
    """A catkin package with the controller in C and a node that runs it.

    The node reads sensors from topics and publishes commands, as defined by a mapping in YAML.
    """

    form: ClassVar[str] = "ros1"
    untried: ClassVar[str] = "the node, which catkin compiles"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the package; its name is the prefix in lower case.

        Raises InputError for a parameter set, which steers no robot, and for prefixes with the name of
        another file or package.
        """
        values = values_of(subject, prefix)
        own = {name: render(f"ros1/{name}", values) for name in _ROS1_TEMPLATES}
        check_package(prefix, own["package.xml"])
        return {
            **own,
            **sources(subject, prefix, values),
            "config/mapping.template.yaml": mapping(subject),
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile and run the controller's source without ROS, as for `--to c`."""
        return C().run(folder / "src", prefix, sequences)


_ROS2_TEMPLATES = (
    "package.xml",
    "CMakeLists.txt",
    "README.md",
    "src/graph.hpp",
    "src/swarmwright_controller.cpp",
    "src/yaml.cpp",
    "src/yaml.hpp",
    "config/parameters.yaml",
    "scripts/swarmwright_controller_python",
)
"""Templates of ROS 2 only, without modules."""
_MODULES = ("__init__", "dds_node", "exported", "rclpy_node")
"""Modules from templates."""
_COPIED = (
    "control",
    "dds",
    "fields",
    "mapping",
    "middleware",
    "rclpy_middleware",
    "topics",
)
"""Modules copied from `simulations.ros`, so that robots do not need Swarmwright."""
_LIBRARIES = frozenset({"cyclonedds", "launch", "launch_ros", "rclpy", "yaml"})
"""Modules that the nodes import, which a package must not shadow."""
_ROS = Path(__file__).parents[1] / "simulations" / "ros"


class Ros2(Exporter):
    """An ament package with the controller in C and in Python, and nodes that run it.

    One node uses rclcpp, one uses rclpy, and one uses DDS without ROS 2. All read sensors from topics and
    publish commands, as defined by the same mapping in YAML.
    """

    form: ClassVar[str] = "ros2"
    untried: ClassVar[str] = "the nodes, which colcon builds"
    longest: ClassVar[int] = Python.longest

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the package; its name is the prefix in lower case.

        Raises InputError for a parameter set, which steers no robot, and for prefixes with the name of
        another file or package.
        """
        values = values_of(subject, prefix)
        values["numpy"] = "  <exec_depend>python3-numpy</exec_depend>" if has_user_modules(subject) else ""
        package = values["package"]
        if package in {*_MODULES, *_COPIED}:
            raise InputError(f"prefix: {prefix!r} is a file of the package; choose another prefix")
        if package in _LIBRARIES:
            raise InputError(f"prefix: {prefix!r} is a module that the nodes import; choose another prefix")
        own = {name: render(f"ros2/{name}", values) for name in _ROS2_TEMPLATES}
        check_package(prefix, own["package.xml"])
        python = Python().files(subject, prefix)
        del python[f"{prefix}_test.py"]
        return {
            **own,
            **sources(subject, prefix, values),
            "config/mapping.template.yaml": mapping(subject),
            "launch/controller.launch.py": render("python_ros2/controller.launch.txt", values),
            **{f"{package}/{name}": content for name, content in python.items()},
            **{f"{package}/{name}.py": render(f"python_ros2/{name}.txt", values) for name in _MODULES},
            **{f"{package}/{name}.py": copy_of(_ROS / f"{name}.py") for name in _COPIED},
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Run the controller in both languages; return the result of C if it is wrong, else of Python."""
        compiled = C().run(folder / "src", prefix, sequences)
        interpreted = Python().run(folder / prefix.lower(), prefix, sequences)
        _, wrong = measure_difference(sequences, compiled)
        return compiled if wrong else interpreted
