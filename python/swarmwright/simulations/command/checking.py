"""Reading and checking definitions of simulations that run as processes."""

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


def get_definition_class(values: Mapping[str, Any]) -> type[Definition]:
    """Return the class of definition for a mapping in an experiment."""
    if "command" in values:
        return CommandOptions
    return RosOptions if "ros" in values else FmuOptions if "fmu" in values else CommandOptions


def parse_name(name: str) -> Definition:
    """Return the definition in the name of a simulation that runs as a process."""
    return KINDS[SimulationName.parse(name).prefix].parse(name)


def read_definition(
    values: Mapping[str, Any], folder: Path, base: Path | None = Path()
) -> tuple[Definition | None, list[tuple[Path_, str]]]:
    """Read a definition with paths relative to a folder; return it, and its problems with their keys.

    base: the folder that `folder` is relative to; None if files were checked before.
    """
    kind = get_definition_class(values)
    try:
        options = kind.model_validate(dict(values))
    except ValidationError as error:
        return None, problems_of(error, kind)
    options = options.model_copy(update={"folder": str(folder / options.folder)})
    if base is None:
        return options, []
    rebased = options.rebase(base)
    try:
        check_utf8(str(Path(rebased.folder).resolve()))
    except InputError as error:
        return None, [(("folder",), str(error))]
    problems = rebased.problems()
    return None if problems else options, problems


def require_definition(values: Mapping[str, Any], folder: Path, where: str) -> CommandOptions:
    """Read the definition of a command. Raises InputError with `where` at the beginning of each line."""
    if not isinstance(values, Mapping):
        raise InputError(f"{where}.definition: {values!r} found, expected a mapping with command, log, ..")
    options, problems = read_definition(values, folder)
    if not isinstance(options, CommandOptions):
        lines = (f"{where}.definition: {format_path(path)}: {message}" for path, message in problems)
        raise InputError("\n".join(lines))
    return options
