"""Whether the controllers of an experiment fit a simulation with other parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import Source
from swarmwright.experiment.derived import steers_agents
from swarmwright.experiment.settings import SIZES
from swarmwright.simulations import catalogue

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment

_ROBOT = "robot"
"""Parameter of the arena by whose value sensors and actuators differ."""


def check_fits(experiment: "Experiment", source: Source) -> None:
    """Check that agents still have as many sensors and actuators as the controllers were made for.

    Args:
        experiment: which has them written out.
        source: of the experiment with settings; one that sets them is not checked here.

    Raises InputError with the robots that have as many, where there are such.
    """
    values = source.values
    simulation, parameters = values.get("simulation"), values.get("parameters", {})
    sizes = {name: getattr(experiment, name) for name in SIZES}
    kept = all(values.get(name) == size for name, size in sizes.items())
    if not (kept and isinstance(simulation, str) and isinstance(parameters, Mapping)):
        return
    if catalogue.built_in(simulation) is None or None in sizes.values() or not steers_agents(experiment):
        return
    found = announced_sizes(simulation, dict(parameters))
    if found is None or found == sizes:
        return
    has, needs = (_words(one) for one in (found, sizes))
    robot = parameters.get(_ROBOT)
    whose = f"the robot {robot}" if isinstance(robot, str) else f"{simulation} with these parameters"
    fitting = [
        name
        for name in _robots(simulation)
        if announced_sizes(simulation, {**parameters, _ROBOT: name}) == sizes
    ]
    cure = f"; robots that fit: {', '.join(fitting)}" if fitting else ""
    raise InputError(f"controller: was evolved for {needs}, but {whose} has {has}, so it does not fit{cure}")


def announced_sizes(simulation: str, parameters: dict[str, Any]) -> dict[str, int] | None:
    """Return how many sensors and actuators agents have; None where it is not known here, or cannot be.

    That is for simulations that others offer, and for parameters that are wrong.
    """
    if not catalogue.is_described(simulation):
        return None
    try:
        announced = catalogue.description(simulation, parameters)
    except InputError:
        return None
    return {name: announced[name] for name in SIZES}


def _words(sizes: Mapping[str, int]) -> str:
    return " and ".join(f"{count} {name if count != 1 else name[:-1]}" for name, count in sizes.items())


def _robots(simulation: str) -> list[str]:
    """Return the names of robots that a simulation knows."""
    return _engine.robots() if _ROBOT in catalogue.parameter_names(simulation) else []
