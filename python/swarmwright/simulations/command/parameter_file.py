"""Reading and writing parameter files of commands."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import dump, read
from swarmwright.simulations.command.logs import flat

FILES = {"yaml": "parameters.yaml", "json": "parameters.json", "ros2": "parameters.yaml"}
"""Names of the files in the work folder, by their format."""
_ROS2 = "ros__parameters"


def read_defaults(path: Path) -> dict[str, Any]:
    """Return the parameters in a file; nested ones have names such as pid.kp.

    Raises InputError if the file cannot be read.
    """
    source = read(path)
    for _, line, message in source.problems:
        raise InputError(f"{path}:{line}: {message}")
    values = source.values
    if not isinstance(values, dict):
        raise InputError(f"{path}: contains no parameters, expected lines such as speed: 0.5")
    values = _unwrap_ros_parameters(values)
    parameters = dict(flat(values))
    parameters.pop("seed", None)  # each episode has its own
    return parameters


def _unwrap_ros_parameters(values: Mapping[str, Any]) -> Mapping[str, Any]:
    if len(values) == 1:
        inner = next(iter(values.values()))
        if isinstance(inner, Mapping) and list(inner) == [_ROS2] and isinstance(inner[_ROS2], Mapping):
            parameters: Mapping[str, Any] = inner[_ROS2]
            return parameters
    return values


def format_file(values: Mapping[str, Any], form: str) -> str:
    """Return the text of a parameter file. form: yaml, json or ros2."""
    nested = _nest(values)
    if form == "json":
        return json.dumps(nested, indent=2) + "\n"
    return dump({"/**": {_ROS2: nested}} if form == "ros2" else nested)


def _nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested mappings for names with dots."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        inner = result
        *above, last = name.split(".") if all(name.split(".")) else [name]
        for part in above:
            child = inner.setdefault(part, {})
            if not isinstance(child, dict):
                raise InputError(f"{name}: {part} is a parameter, so it cannot contain others")
            inner = child
        if isinstance(inner.get(last), dict):
            raise InputError(f"{name}: contains other parameters, so it cannot be a parameter itself")
        inner[last] = value
    return result
