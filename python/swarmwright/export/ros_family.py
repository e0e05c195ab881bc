"""What the forms ROS 1 and ROS 2 have in common: the sources of the node, and the mapping to be filled in."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.untrusted import in_json, one_line
from swarmwright.export._base import Files, facts
from swarmwright.export.c import C
from swarmwright.export.subject import Channel, Subject
from swarmwright.export.text import MARK, c_literal, quoted, render
from swarmwright.representations.controller import controller_words

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
"""Sources that are the same for every controller and both."""
_OWN = "exported"
"""What a file of the package is called."""
_SCALING = """\
# Where a comment below has a range, -1 to 1 for LOW to HIGH, scale and offset convert between it and -1 to 1:
# change them where the topic has another unit.
#"""


def values_of(subject: Subject, prefix: str) -> dict[str, str]:
    """Return what is put into the templates.

    Raises InputError for a parameter set, which steers nothing, and for the prefix `exported`.
    """
    if not subject.steers:
        raise InputError(
            "controller: a parameter set steers no robot, so no node can run it; --to c writes its values"
        )
    if prefix.lower() == _OWN:
        raise InputError(f"prefix: {prefix!r} is a file of the package; take another one")
    return {
        "mark": MARK,
        "p": prefix,
        "PREFIX": prefix.upper(),
        "package": prefix.lower(),
        "words": controller_words(dict(subject.specification)),
        "facts": facts(subject),
        "sensor_names": _names(subject.sensors, c_literal),
        "actuator_names": _names(subject.actuators, c_literal),
        "python_sensor_names": _names(subject.sensors, quoted),
        "python_actuator_names": _names(subject.actuators, quoted),
    }


def sources(subject: Subject, prefix: str, values: dict[str, str]) -> Files:
    """Return the controller in C, and what of the node in C++ is the same in ROS 1 and ROS 2; in `src`."""
    code = C().files(subject, prefix)
    return {
        f"src/{prefix}.h": code[f"{prefix}.h"],
        f"src/{prefix}.c": code[f"{prefix}.c"],
        "src/exported.c": render("ros/src/exported.c", values),
        **{f"src/{name}": render(f"ros/src/{name}", values) for name in _SHARED},
    }


def mapping(subject: Subject) -> str:
    """Return a mapping with an entry for each sensor and actuator, to be filled in.

    Of a controller that was evolved on robots of a ROS system it has their topics.
    """
    rate = subject.topics.get("rate", 10)
    return render(
        "ros/mapping.template.yaml",
        {
            "mark": MARK,
            "facts": facts(subject, "#   "),
            "begin": _begin(subject),
            "scaling": _SCALING if subject.conversion else "",
            "rate": f"{rate:g}".ljust(24),
            "sensors": _entries("sensor", subject.sensors, subject.topics.get("sensors", ())),
            "actuators": _entries("actuator", subject.actuators, subject.topics.get("actuators", ())),
        },
    )


def unique_names(channels: Sequence[Channel]) -> list[str]:
    """Return names by which the node tells sensors or actuators apart."""
    count = Counter(channel.name for channel in channels)
    return [
        channel.name if count[channel.name] == 1 else f"{channel.name} {index}"
        for index, channel in enumerate(channels)
    ]


def _names(channels: Sequence[Channel], literal: Callable[[str], str]) -> str:
    return "\n".join(f"    {literal(name)}," for name in unique_names(channels))


def _begin(subject: Subject) -> str:
    if subject.topics:
        return "Copy this to mapping.yaml and check it. Topics are those on which the controller was evolved."
    return "Copy this to mapping.yaml and fill it in."


def _entries(kind: str, channels: Sequence[Channel], known: Sequence[Mapping[str, Any]]) -> str:
    """Return entries; what is known of a sensor or actuator of a name is filled in."""
    by_name = {entry[kind]: entry for entry in known}
    lines = []
    for name, channel in zip(unique_names(channels), channels, strict=True):
        begin = f"  - {kind}: {in_json(json.dumps(name, ensure_ascii=False))}"
        unit = f"{one_line(channel.unit)}, " if channel.unit else ""
        values = {"topic": "", "type": "", "field": "", **by_name.get(name, _scaling(kind, channel))}
        lines.append(f"{begin:<30}# {unit}{one_line(channel.limits)}")
        for key, value in values.items():
            if key != kind and not (key == "field" and value == "" and name in by_name):
                shown = _number(value) if isinstance(value, float) else json.dumps(value)
                lines.append(f"    {key}: {shown}")
    return "\n".join(lines)


def _scaling(kind: str, channel: Channel) -> dict[str, float]:
    """Return factor and summand of a sensor or actuator that the simulation scaled, in its unit."""
    if channel.range is None:
        return {}
    scale, offset = channel.range.from_value if kind == "sensor" else channel.range.to_value
    return {"scale": scale, "offset": offset + 0.0}


def _number(value: float) -> str:
    """Return a number that readers of YAML 1.1, too, take for one: an exponent needs a point before it."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
