"""A package for ROS 2: `--to ros2`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.export import ros_family
from swarmwright.export._base import Exporter, Files, render
from swarmwright.export.c import C
from swarmwright.export.python import Python
from swarmwright.export.python_modules import copy_of, has_own
from swarmwright.export.sequences import Sequences, difference
from swarmwright.export.subject import Subject

_TEMPLATES = (
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
"""What only ROS 2 has, beside modules."""
_MODULES = ("__init__", "dds_node", "exported", "rclpy_node")
"""Modules that are written for the package."""
_COPIED = (
    "control",
    "dds",
    "dds_messages",
    "fields",
    "mapping",
    "middleware",
    "names",
    "rclpy_middleware",
    "topics",
)
"""Modules of `simulations.ros`, which the package has copies of, so that robots need no Swarmwright."""
_LIBRARIES = frozenset({"cyclonedds", "launch", "launch_ros", "rclpy", "yaml"})
"""Modules that the nodes import: a package of such a name would be in their place."""
_ROS = Path(__file__).parents[1] / "simulations" / "ros"


class Ros2(Exporter):
    """An ament package with the controller in C and in Python, and nodes that run it.

    One node uses rclcpp, one rclpy, and one needs no ROS 2: it speaks DDS. All read sensors from topics and
    publish commands as the same mapping in YAML says.
    """

    form: ClassVar[str] = "ros2"
    untried: ClassVar[str] = "the nodes, which colcon builds"
    longest: ClassVar[int] = Python.longest

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the package; its name is the prefix in small letters.

        Raises InputError for a parameter set, which steers nothing, and for prefixes that other files or
        packages have.
        """
        values = ros_family.values_of(subject, prefix)
        values["numpy"] = "  <exec_depend>python3-numpy</exec_depend>" if has_own(subject) else ""
        package = values["package"]
        if package in {*_MODULES, *_COPIED}:
            raise InputError(f"prefix: {prefix!r} is a file of the package; take another one")
        if package in _LIBRARIES:
            raise InputError(f"prefix: {prefix!r} is a module that the nodes import; take another one")
        own = {name: render(f"ros2/{name}", values) for name in _TEMPLATES}
        ros_family.check_package(prefix, own["package.xml"])
        python = Python().files(subject, prefix)
        del python[f"{prefix}_test.py"]
        return {
            **own,
            **ros_family.sources(subject, prefix, values),
            "config/mapping.template.yaml": ros_family.mapping(subject),
            "launch/controller.launch.py": render("python_ros2/controller.launch.txt", values),
            **{f"{package}/{name}": content for name, content in python.items()},
            **{f"{package}/{name}.py": render(f"python_ros2/{name}.txt", values) for name in _MODULES},
            **{f"{package}/{name}.py": copy_of(_ROS / f"{name}.py") for name in _COPIED},
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Run the controller in both languages; return what C computed, unless only that is right."""
        compiled = C().run(folder / "src", prefix, sequences)
        interpreted = Python().run(folder / prefix.lower(), prefix, sequences)
        _, wrong = difference(sequences, compiled)
        return compiled if wrong else interpreted
