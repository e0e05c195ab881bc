"""Simulations as environments for reinforcement learning: PettingZoo for swarms, Gymnasium for one agent.

    env = swarmwright.environments.parallel_env("arena", {"mission": "aggregation"})

Reinforcement learning libraries train with them in the same simulations, missions and robots in which
controllers evolve. The sum of an episode's rewards is its fitness.
"""

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.export.environments._parallel import SwarmEnv
    from swarmwright.export.environments._world import AgentEnv

__all__ = ["gymnasium_env", "parallel_env"]


def parallel_env(
    simulation: "Experiment | Mapping[str, Any] | str | PathLike[str] | type",
    parameters: Mapping[str, Any] | None = None,
    *,
    render_mode: Literal["rgb_array"] | None = None,
) -> "SwarmEnv":
    """Return a simulation as a parallel PettingZoo environment: all agents act in each step.

    Agents are named agent_0, agent_1, .., or after their group. Observations are an agent's sensors,
    unbounded float32; actions are its actuators, float32 in -1..1. All agents get the same reward, the change
    of the fitness; its sum over an episode is the fitness. At the end, all agents are truncated if the time
    of a built-in simulation was over, as always in the arena, else terminated, with `fitness` and `metrics`
    in their infos. Copies, also by pickle, start without an episode. `reset(seed=S)` begins the episode of
    the simulation with this seed; without a seed, the episode of the next seed, initially `parameters.seed`
    (0).

    Args:
        simulation: the name of a built-in simulation, `FILE:Class`, a class, or an experiment, its file
            (.yaml)
            or a mapping with its keys, whose simulation, parameters and fitness are used.
        parameters: parameters of the simulation, as in an experiment; for an experiment, only the changes.
        render_mode: rgb_array: `render()` returns a picture, (height, width, 3) of uint8.

    Raises InputError when PettingZoo is not installed, the simulation is unknown, rejects the parameters, or
    controls its agents itself.
    """
    try:
        from swarmwright.export.environments._parallel import SwarmEnv  # noqa: PLC0415 - PettingZoo may be missing
        from swarmwright.export.environments._world import World  # noqa: PLC0415 - as above
    except ImportError as error:
        raise _missing(error, "pettingzoo") from None
    return SwarmEnv(World(simulation, parameters, render_mode))


def gymnasium_env(
    simulation: "Experiment | Mapping[str, Any] | str | PathLike[str] | type",
    parameters: Mapping[str, Any] | None = None,
    *,
    render_mode: Literal["rgb_array"] | None = None,
) -> "AgentEnv":
    """Return a simulation with one agent as a Gymnasium environment; otherwise as `parallel_env`.

    Args:
        simulation: as in `parallel_env`.
        parameters: as in `parallel_env`.
        render_mode: as in `parallel_env`.

    Raises InputError when Gymnasium is not installed, for a simulation with several agents, and in the
    cases of `parallel_env`.
    """
    try:
        from swarmwright.export.environments._world import AgentEnv, World  # noqa: PLC0415 - Gymnasium may be missing
    except ImportError as error:
        raise _missing(error, "gymnasium") from None
    return AgentEnv(World(simulation, parameters, render_mode))


def _missing(error: ImportError, extra: str) -> InputError:
    return InputError(f"environments: {error}: pip install 'swarmwright[{extra}]'")
