"""Names of adapted environments: `library:environment?option=value&option=value`."""

import ast
import json
import re
from typing import Any

from swarmwright.core.errors import InputError

LIBRARIES = {"gymnasium": "Gymnasium", "pettingzoo": "PettingZoo", "vmas": "Vmas"}
"""Library, which is the adapter's module, too -> its class."""

_NAME = re.compile(rf"({'|'.join(LIBRARIES)}):([^\s?]+)(?:\?(\S*))?")


def is_adapted(simulation: str) -> bool:
    """Whether a simulation is named as an environment of another library."""
    return _NAME.fullmatch(simulation) is not None


def split(name: str) -> tuple[str, str, dict[str, Any]]:
    """Return library, environment and options. Raises InputError for options that are not `name=value`."""
    match = _NAME.fullmatch(name)
    assert match is not None
    options = {}
    for part in (match[3] or "").split("&"):
        key, equals, value = part.partition("=")
        if not part:
            continue
        if not equals or not key.isidentifier():
            raise InputError(f"{name}: {part!r} found after the question mark, expected option=value")
        options[key] = _value(value)
    return match[1], match[2], options


def _value(text: str) -> Any:  # noqa: ANN401 - any value that JSON has
    """Return a value written as in JSON or Python, else as text."""
    for read in (json.loads, ast.literal_eval):
        try:
            return read(text)
        except (ValueError, SyntaxError):
            continue
    return text
