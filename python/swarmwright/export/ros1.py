"""A package for ROS 1: `--to ros1`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.export import ros_family
from swarmwright.export._base import Exporter, Files, render
from swarmwright.export.c import C
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_TEMPLATES = (
    "package.xml",
    "CMakeLists.txt",
    "src/graph.hpp",
    "src/swarmwright_controller.cpp",
    "launch/controller.launch",
)
"""What only ROS 1 has."""


class Ros1(Exporter):
    """A catkin package with the controller in C and a node that runs it.

    The node reads sensors from topics and publishes commands, as a mapping in YAML says.
    """

    form: ClassVar[str] = "ros1"
    untried: ClassVar[str] = "the node, which catkin compiles"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the package; its name is the prefix in small letters.

        Raises InputError for a parameter set, which steers nothing, and for prefixes that other files or
        packages have.
        """
        values = ros_family.values_of(subject, prefix)
        own = {name: render(f"ros1/{name}", values) for name in _TEMPLATES}
        ros_family.check_package(prefix, own["package.xml"])
        return {
            **own,
            **ros_family.sources(subject, prefix, values),
            "config/mapping.template.yaml": ros_family.mapping(subject),
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile and run the controller's source without ROS, as `--to c` does."""
        return C().run(folder / "src", prefix, sequences)
