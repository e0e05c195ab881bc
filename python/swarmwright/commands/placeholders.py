"""Placeholders in commands, environments and files: {seed}, {parameters}, {speed}, .."""

import re
from collections.abc import Mapping

from swarmwright.core.errors import InputError
from swarmwright.core.suggestions import did_you_mean

_NAME = r"[A-Za-z_][\w.\-/]*"
_PLACE = re.compile(rf"\{{\{{{_NAME}\}}\}}|(?<!\$)\{{({_NAME})\}}")
"""{{name}}, which stands for {name}, or a placeholder; ${name} is a shell's variable."""
IN_A_COMMAND = {
    "parameters": "the path of the parameter file",
    "controller": "the path of the controller's file",
    "weights": "the path of the file with the controller's weights",
    "log": "the path of the log",
    "folder": "the work folder",
    "build": "the folder of what was compiled",
    "here": "the folder of the experiment file",
    "seed": "the episode's seed",
    "episode": "the number of the episode",
    "instance": "the number of the instance",
    "port": "a free TCP port",
}
"""What can be put into a command beside the simulation's parameters, and what it stands for."""


def names_in(text: str) -> list[str]:
    """Return the names of the placeholders in a word of a command."""
    return [match[1] for match in _PLACE.finditer(text) if match[1] is not None]


def filled(text: str, values: Mapping[str, object], where: str) -> str:
    """Return a word of a command, or a variable's value, with its placeholders filled in.

    Raises InputError, beginning with `where`, for a placeholder that has no value.
    """

    def value(match: re.Match[str]) -> str:
        if match[1] is None:
            return match[0][1:-1]
        if match[1] not in values:
            hint = did_you_mean(match[1], values) or f"; available: {', '.join(values)}"
            raise InputError(
                f"{where}: {{{match[1]}}} is not a placeholder, and no parameter has this name{hint}"
            )
        return plain(values[match[1]])

    return _PLACE.sub(value, text)


def filled_file(text: str, values: Mapping[str, object]) -> str:
    """Return a file's text with known placeholders filled in; all other braces stay as they are."""

    def value(match: re.Match[str]) -> str:
        return plain(values[match[1]]) if match[1] in values else match[0]

    return _PLACE.sub(value, text)


def plain(value: object) -> str:
    """Return a value as programs read it: true, 0.25, text."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)
