"""What the engine's built-in simulations say about themselves."""

import json
from functools import cache
from typing import Any

from swarmwright._errors import InputError, engine_errors


@cache
def titles() -> tuple[str, ...]:
    """Return the titles of the built-in simulations, sorted."""
    from swarmwright import _engine

    return tuple(_engine.simulations())


@cache
def _description(title: str) -> str:
    from swarmwright import _engine

    with engine_errors():
        return _engine.describe(title)


def description(title: str) -> dict[str, Any]:
    """Return what a built-in simulation says of itself.

    Title, dimensions, max_agents, sensors, actuators, parameters, and metrics (name -> unit, description).
    """
    described: dict[str, Any] = json.loads(_description(title))
    return described


def parameter_names(title: str) -> list[str]:
    """Return the names of a built-in simulation's parameters, the seed among them."""
    return list(dict.fromkeys([*description(title)["parameters"], "seed"]))


def steers_itself(title: str, parameters: dict[str, Any]) -> bool:
    """Return whether the agents of a built-in simulation steer themselves with these parameters.

    Raises InputError for parameters that the simulation refuses.
    """
    from swarmwright import _engine

    with engine_errors():
        return _engine.steers_itself(title, json.dumps(parameters, allow_nan=False))


def parameters_problem(title: str, parameters: dict[str, Any]) -> str | None:
    """Return what is wrong with the parameters of a built-in simulation, None when nothing is."""
    from swarmwright import _engine

    try:
        with engine_errors():
            _engine.check_parameters(title, json.dumps(parameters, allow_nan=False))
    except InputError as error:
        return str(error)
    except ValueError:
        return "a number is not finite; .inf and .nan cannot be sent to a simulation"
    return None
