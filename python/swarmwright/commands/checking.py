"""Checking a definition that a person has written."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from swarmwright.commands.definition import CommandOptions
from swarmwright.core.errors import InputError
from swarmwright.core.problems import problems_of
from swarmwright.core.yaml import Path_, dotted_path


def read_definition(
    values: Mapping[str, Any], folder: Path
) -> tuple[CommandOptions | None, list[tuple[Path_, str]]]:
    """Return a definition, paths relative to a folder, and what is wrong with it, with the keys."""
    try:
        options = CommandOptions.model_validate(dict(values))
    except ValidationError as error:
        problems = problems_of(error, CommandOptions)
        return None, [_placed(path, message) for path, message in problems]
    return options.model_copy(update={"folder": str(folder / options.folder)}), []


def _placed(path: Path_, message: str) -> tuple[Path_, str]:
    """Return a problem of several keys with the first of them, by which its message begins."""
    key, found, rest = message.partition(": ")
    return ((key,), rest) if not path and found and key in CommandOptions.model_fields else (path, message)


def checked_definition(values: Mapping[str, Any], folder: Path, where: str) -> CommandOptions:
    """Return a definition. Raises InputError, every line beginning with `where`."""
    if not isinstance(values, Mapping):
        raise InputError(f"{where}.definition: {values!r} found, expected a mapping with command, log, ..")
    options, problems = read_definition(values, folder)
    if options is None:
        lines = (f"{where}.definition: {dotted_path(path)}: {message}" for path, message in problems)
        raise InputError("\n".join(lines))
    return options
