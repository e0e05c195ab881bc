"""A package for ROS 1: `--to ros1`."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.errors import InputError
from swarmwright.export._base import Exporter, Files, facts
from swarmwright.export.c import C
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject
from swarmwright.export.text import MARK, render
from swarmwright.representations.controller import controller_words

_SOURCES = (
    "src/exported.h",
    "src/mapping.cpp",
    "src/mapping.hpp",
    "src/swarmwright_controller.cpp",
    "src/topics.cpp",
    "src/topics.hpp",
)
"""The same for every controller."""
_OWN = "exported"
"""What a file of the package is called."""


class Ros1(Exporter):
    """A catkin package with the controller in C and a node that runs it.

    The node reads sensors from topics and publishes commands, as a mapping in YAML says.
    """

    form: ClassVar[str] = "ros1"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the package; its name is the prefix in small letters.

        Raises InputError for a parameter set, which steers nothing, and for the prefix `exported`.
        """
        if not subject.steers:
            raise InputError(
                "controller: a parameter set steers no robot, so no node can run it; --to c writes its values"
            )
        if prefix.lower() == _OWN:
            raise InputError(f"prefix: {prefix!r} is a file of the package; take another one")
        code = C().files(subject, prefix)
        values = {
            "mark": MARK,
            "p": prefix,
            "PREFIX": prefix.upper(),
            "package": prefix.lower(),
            "words": controller_words(dict(subject.specification)),
            "facts": facts(subject),
            "sensor_names": _names(subject.sensors),
            "actuator_names": _names(subject.actuators),
        }
        mapping = {
            "mark": MARK,
            "facts": facts(subject, "#   "),
            "sensors": _entries("sensor", subject.sensors),
            "actuators": _entries("actuator", subject.actuators),
        }
        return {
            "package.xml": render("ros1/package.xml", values),
            "CMakeLists.txt": render("ros1/CMakeLists.txt", values),
            f"src/{prefix}.h": code[f"{prefix}.h"],
            f"src/{prefix}.c": code[f"{prefix}.c"],
            "src/exported.c": render("ros1/src/exported.c", values),
            **{name: render(f"ros1/{name}", values) for name in _SOURCES},
            "config/mapping.template.yaml": render("ros1/config/mapping.template.yaml", mapping),
            "launch/controller.launch": render("ros1/launch/controller.launch", values),
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile and run the controller's source without ROS, as `--to c` does."""
        return C().run(folder / "src", prefix, sequences)


def _unique(channels: Sequence[Channel]) -> list[str]:
    """Return names by which the node tells sensors or actuators apart."""
    count = Counter(channel.name for channel in channels)
    return [
        channel.name if count[channel.name] == 1 else f"{channel.name} {index}"
        for index, channel in enumerate(channels)
    ]


def _names(channels: Sequence[Channel]) -> str:
    return "\n".join(f'    "{name}",' for name in _unique(channels))


def _entries(kind: str, channels: Sequence[Channel]) -> str:
    """Return the entries of a mapping, to be filled in."""
    lines = []
    for name, channel in zip(_unique(channels), channels, strict=True):
        begin = f'  - {kind}: "{name}"'
        unit = f"{channel.unit}, " if channel.unit else ""
        lines += [f"{begin:<30}# {unit}{channel.limits}", '    topic: ""', '    type: ""', '    field: ""']
    return "\n".join(lines)
