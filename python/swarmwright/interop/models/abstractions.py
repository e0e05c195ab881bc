"""Abstraction descriptions (ADF): sensors and actuators of an agent, with their messages of ROS.

`{"runtime-env": "ROS", "sensors/actuators": [{"name", "description", "category", "api"}]}`, as in the schema
of Modelio's CPSwarm module, `api` with `inputs` and `outputs`. A sensor has the numbers of its output
messages, an actuator those of its input messages.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from swarmwright.common.problems import format_value
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.yaml import Path_, Source
from swarmwright.interop.models._parts import Part, Problems

WORDS = 'an abstraction description ({"runtime-env": "ROS", "sensors/actuators": [..]})'
_COMPONENTS = "sensors/actuators"
_CATEGORIES = ("Sensor", "Actuator", "Virtual")
_KEYS = frozenset({"runtime-env", _COMPONENTS, "functions"})
_NUMBERS = frozenset(
    {"bool", "byte", "char", "float32", "float64", "number", "double", "float", "integer", "int"}
    | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)
_NO_NUMBERS = frozenset({"string", "time", "duration", "Header"})
_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_POSE = (*(f"position.{axis}" for axis in _XYZ), *(f"orientation.{axis}" for axis in _XYZW))
_TWIST = tuple(f"{part}.{axis}" for part in ("linear", "angular") for axis in _XYZ)
_MESSAGES = {
    "Point": _XYZ,
    "Point32": _XYZ,
    "Vector3": _XYZ,
    "Quaternion": _XYZW,
    "Pose": _POSE,
    "Pose2D": ("x", "y", "theta"),
    "Twist": _TWIST,
}
"""Messages of ROS's geometry_msgs -> their numbers, the same for `..Stamped`."""
_PLAIN = re.compile(r"(?:Float|U?Int)(?:8|16|32|64)|Bool|Byte|Char")
"""Messages of ROS's std_msgs with one number, `data`."""
_ARRAY = re.compile(r"(.+)\[(\d{0,6})\]")
_LONGEST_ARRAY = 1000
"""Longest array in a message."""


def recognises(values: object) -> bool:
    """Whether a JSON value is an abstraction description."""
    return isinstance(values, Mapping) and ("runtime-env" in values or _COMPONENTS in values)


def load(path: Path, source: Source) -> Part:
    """Read sensors and actuators. Raises InputError with all problems, each with file and line."""
    problems = Problems()
    part = Part(path, WORDS)
    values = source.values
    for key in values:
        if key not in _KEYS:
            _add_problem(
                source,
                (key,),
                f"unknown key{did_you_mean(key, _KEYS) or '; expected ' + _COMPONENTS}",
                problems,
            )
    environment = values.get("runtime-env", "ROS")
    if environment != "ROS":
        _add_problem(source, ("runtime-env",), f"{format_value(environment)} found, expected ROS", problems)
    components = values.get(_COMPONENTS, [])
    if not isinstance(components, list):
        _add_problem(source, (_COMPONENTS,), f"expected a list, not {format_value(components)}", problems)
        components = []
    names: dict[str, int] = {}
    for index, component in enumerate(components):
        _component(part, source, (_COMPONENTS, index), component, names, problems)
    if values.get("functions"):
        part.notes.append(f"{path}: functions are not imported, since the description does not define them")
    problems.stop()
    part.sensors = len(part.sensor_names) or None
    part.actuators = len(part.actuator_names) or None
    return part


def _add_problem(source: Source, at: Path_, message: str, problems: Problems) -> None:
    problems.lines.add(f"{source.locate(at)}{message}")


def _component(
    part: Part, source: Source, at: Path_, component: object, names: dict[str, int], problems: Problems
) -> None:
    if not isinstance(component, Mapping):
        _add_problem(
            source,
            at,
            f"expected an object with name, category and api, not {format_value(component)}",
            problems,
        )
        return
    name, category, api = (component.get(key) for key in ("name", "category", "api"))
    if not isinstance(name, str) or not name.strip():
        _add_problem(source, at, "name is missing", problems)
        return
    if name in names:
        _add_problem(
            source, (*at, "name"), f"duplicate name {name!r} (first in line {names[name]})", problems
        )
    names.setdefault(name, source.lines.get((*at, "name"), 0))
    if category not in _CATEGORIES:
        hint = did_you_mean(str(category), _CATEGORIES)
        _add_problem(
            source,
            at,
            f"category: {format_value(category)} found, expected {', '.join(_CATEGORIES)}{hint}",
            problems,
        )
        return
    if not isinstance(api, Mapping):
        _add_problem(
            source, at, f"api: expected an object with inputs or outputs, not {format_value(api)}", problems
        )
        return
    if category == "Virtual":
        part.notes.append(f"{part.path}: {name} is virtual and was not imported")
        return
    direction = "outputs" if category == "Sensor" else "inputs"
    numbers = list(_numbers(source, (*at, "api", direction), api.get(direction), problems))
    if not numbers:
        _add_problem(
            source,
            (*at, "api"),
            f"the {direction} of the {category.lower()} {name} have no numbers",
            problems,
        )
    target = part.sensor_names if category == "Sensor" else part.actuator_names
    target += [name] if len(numbers) == 1 else [f"{name}.{number}" for number in numbers]


def _numbers(source: Source, at: Path_, messages: object, problems: Problems) -> Iterator[str]:
    """Yield the names of all numbers in messages."""
    if not isinstance(messages, list):
        if messages is not None:
            _add_problem(source, at, f"expected a list of messages, not {format_value(messages)}", problems)
        return
    for index, message in enumerate(messages):
        key = "msg_def" if isinstance(message, Mapping) and "msg_def" in message else "msg"
        definition = message.get(key) if isinstance(message, Mapping) else None
        if not isinstance(definition, Mapping):
            _add_problem(source, (*at, index), "expected an object with topic and msg_def", problems)
            continue
        prefix = f"{message.get('topic', index)}." if len(messages) > 1 else ""
        path = (*at, index, key)
        fields = definition.get("fields")
        if fields is None:
            fields = [{"class": definition.get("class"), "name": ""}]
        if not isinstance(fields, list):
            _add_problem(source, (*path, "fields"), f"expected a list, not {format_value(fields)}", problems)
            continue
        for number, field in enumerate(fields):
            yield from (prefix + name for name in _field(source, (*path, "fields", number), field, problems))


def _field(source: Source, at: Path_, field: Any, problems: Problems) -> list[str]:  # noqa: ANN401 - whatever the file says
    kind, name = (field.get(key) for key in ("class", "name")) if isinstance(field, Mapping) else (None, None)
    if not isinstance(kind, str) or not isinstance(name, str):
        _add_problem(source, at, "expected an object with class and name", problems)
        return []
    array = _ARRAY.fullmatch(kind.strip())
    plain = (array[1] if array else kind).strip().rpartition("/")[2]
    if plain in _NO_NUMBERS:
        return []
    parts = ("data",) if _PLAIN.fullmatch(plain) else _MESSAGES.get(plain.removesuffix("Stamped"))
    if plain not in _NUMBERS and parts is None:
        _add_problem(
            source,
            at,
            f"class: {kind!r} is neither a number nor a known message; list its fields instead",
            problems,
        )
        return []
    items = [f"{name}[{index}]" for index in range(_count(source, at, array, problems))] if array else [name]
    return (
        items if parts is None else [f"{item}.{part}".removeprefix(".") for item in items for part in parts]
    )


def _count(source: Source, at: Path_, array: re.Match[str], problems: Problems) -> int:
    if not array[2] or not 1 <= int(array[2]) <= _LONGEST_ARRAY:
        _add_problem(
            source,
            at,
            f"class: {array[0]!r} found, expected an array of 1 to {_LONGEST_ARRAY} numbers, {array[1]}[8]",
            problems,
        )
        return 0
    return int(array[2])
