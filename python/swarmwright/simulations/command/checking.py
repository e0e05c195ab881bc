"""Checking a definition that a person has written."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from swarmwright.common.errors import InputError
from swarmwright.common.files import check_utf8
from swarmwright.common.problems import problems_of
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.yaml import Path_, format_path
from swarmwright.simulations.command.definition import CommandOptions, Definition
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.command.ros_definition import RosOptions

KINDS: Mapping[str, type[Definition]] = {
    SimulationName.COMMAND: CommandOptions,
    SimulationName.FMU: FmuOptions,
    SimulationName.ROS: RosOptions,
}


def kind_of(values: Mapping[str, Any]) -> type[Definition]:
    """Return what a mapping in the place of a simulation is meant as."""
    if "command" in values:
        return CommandOptions
    return RosOptions if "ros" in values else FmuOptions if "fmu" in values else CommandOptions


def definition_of_name(name: str) -> Definition:
    """Return what the name of a simulation holds that is run by a command."""
    return KINDS[SimulationName.parse(name).prefix].of(name)


def read_definition(
    values: Mapping[str, Any], folder: Path, base: Path | None = Path()
) -> tuple[Definition | None, list[tuple[Path_, str]]]:
    """Return a definition, paths relative to a folder, and what is wrong with it, with the keys.

    base: what that folder is relative to; None where files were checked before.
    """
    kind = kind_of(values)
    try:
        options = kind.model_validate(dict(values))
    except ValidationError as error:
        return None, problems_of(error, kind)
    options = options.model_copy(update={"folder": str(folder / options.folder)})
    if base is None:
        return options, []
    below = options.below(base)
    try:
        check_utf8(str(Path(below.folder).resolve()))
    except InputError as error:
        return None, [(("folder",), str(error))]
    problems = below.problems()
    return None if problems else options, problems


def checked_definition(values: Mapping[str, Any], folder: Path, where: str) -> CommandOptions:
    """Return a command's definition. Raises InputError, every line beginning with `where`."""
    if not isinstance(values, Mapping):
        raise InputError(f"{where}.definition: {values!r} found, expected a mapping with command, log, ..")
    options, problems = read_definition(values, folder)
    if not isinstance(options, CommandOptions):
        lines = (f"{where}.definition: {format_path(path)}: {message}" for path, message in problems)
        raise InputError("\n".join(lines))
    return options
