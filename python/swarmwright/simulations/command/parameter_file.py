"""Parameter files of commands: what they hold, and writing them anew for an episode."""

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


def defaults(path: Path) -> dict[str, Any]:
    """Return the parameters that a file holds, nested ones with names such as pid.kp.

    Raises InputError when it cannot be read.
    """
    source = read(path)
    for _, line, message in source.problems:
        raise InputError(f"{path}:{line}: {message}")
    values = source.values
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no parameters: expected lines such as speed: 0.5")
    values = _below_nodes(values)
    found = dict(flat(values))
    found.pop("seed", None)  # each episode has its own
    return found


def _below_nodes(values: Mapping[str, Any]) -> Mapping[str, Any]:
    if len(values) == 1:
        inner = next(iter(values.values()))
        if isinstance(inner, Mapping) and list(inner) == [_ROS2] and isinstance(inner[_ROS2], Mapping):
            below: Mapping[str, Any] = inner[_ROS2]
            return below
    return values


def text(values: Mapping[str, Any], form: str) -> str:
    """Return the text of a parameter file. form: yaml, json or ros2."""
    nested = _nested(values)
    if form == "json":
        return json.dumps(nested, indent=2) + "\n"
    return dump({"/**": {_ROS2: nested}} if form == "ros2" else nested)


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return mappings for names with points, where these are all of names."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        inner = result
        *above, last = name.split(".") if all(name.split(".")) else [name]
        for part in above:
            below = inner.setdefault(part, {})
            if not isinstance(below, dict):
                raise InputError(f"{name}: {part} is a parameter, too, and so cannot hold others")
            inner = below
        if isinstance(inner.get(last), dict):
            raise InputError(f"{name}: holds other parameters, and so cannot be one")
        inner[last] = value
    return result
