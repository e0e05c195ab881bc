"""Environments of other libraries as simulations: `gymnasium:CartPole-v1`, `pettingzoo:mpe2.simple_v3`.

Experiments and `swarmwright serve` accept an adapter's name like a simulation's title or class. It consists
of the library, a colon, the library's name of the environment, and, as in a URL, arguments of its
constructor: `pettingzoo:mpe2.simple_spread_v3?N=5&local_ratio=0.2`.
"""

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import LIBRARIES, SimulationName, is_command
from swarmwright.simulations.environments import CLASS_OPTIONS

if TYPE_CHECKING:
    from swarmwright.simulations.base import BatchSimulation, Simulation

__all__ = ["load_adapter"]

_EXAMPLES = {
    "gymnasium": "as gymnasium:CartPole-v1",
    "pettingzoo": "a module that has parallel_env or env, as pettingzoo:mpe2.simple_spread_v3",
    "vmas": "as vmas:navigation",
}


def load_adapter(name: str) -> "type[Simulation | BatchSimulation]":
    """Return the simulation class for an adapter's name.

    Raises InputError if the library is not installed, or has no such environment.
    """
    if is_command(name):
        from swarmwright.simulations.command.checking import parse_name
        from swarmwright.simulations.user_code.command_sources import digest

        return _make_command_class(name, digest(parse_name(name)))
    return _make_library_class(name)


@cache
def _make_library_class(name: str) -> "type[Simulation | BatchSimulation]":
    parsed = SimulationName.parse(name)
    library, environment, options = parsed.library, parsed.location, parsed.options()
    if not environment:
        raise InputError(f"{name} names no environment; expected {library}:ENVIRONMENT, {_EXAMPLES[library]}")
    file, colon, member = environment.partition(":")
    if library != "vmas" and file.endswith(".py"):
        raise InputError(
            f"{name}: {file} is a file, expected a module in the working folder or an installed one; "
            f"write {library}:{Path(file).stem}{colon}{member}"
        )
    try:
        module = import_module(f"swarmwright.simulations.{library}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("swarmwright"):
            raise
        raise InputError(
            f"{name}: {error.name} is not installed; pip install 'swarmwright[{library}]'"
        ) from error
    base: type[Simulation | BatchSimulation] = getattr(module, LIBRARIES[library])
    attributes = _pop_class_options(name, base, options) | {
        "environment": environment,
        "options": options,
        "title": name.partition(":")[2],
        "adapted": name,
        "__module__": base.__module__,
        "__doc__": base.__doc__,
    }
    return type(base.__name__, (base,), attributes)


def _pop_class_options(
    name: str, base: "type[Simulation | BatchSimulation]", options: dict[str, Any]
) -> dict[str, Any]:
    """Remove options that are attributes of the class from the environment's options; return them."""
    attributes: dict[str, Any] = {}
    for option, values in CLASS_OPTIONS.items():
        if hasattr(base, option) and option in options:
            value = options.pop(option)
            if not any(type(value) is type(possible) and value == possible for possible in values):
                expected = " or ".join(str(possible).lower() for possible in values)
                raise InputError(f"{name}: {option}={value} found, expected {expected}")
            attributes[option] = value
    return attributes


@cache
def _make_command_class(name: str, digest: str) -> "type[Simulation]":
    """Return the class of a command; `digest` makes it a new class after a file has changed."""
    parsed = SimulationName.parse(name)
    base: type[Simulation]
    if parsed.prefix == SimulationName.ROS:
        from swarmwright.simulations.command.ros import RosSimulation

        base = RosSimulation
    elif parsed.prefix == SimulationName.FMU:
        from swarmwright.simulations.command.fmu import FmuSimulation

        base = FmuSimulation
    else:
        from swarmwright.simulations.command.simulation import CommandSimulation

        base = CommandSimulation
    attributes = {
        "adapted": name,
        "digest": digest,
        "__module__": base.__module__,
        "__doc__": base.__doc__,
    }
    return type(parsed.label, (base,), attributes)
