"""Episodes of the engine whose robots have machines in Python."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.engine_types import SceneArrays, SceneFields
from swarmwright.common.errors import RunError
from swarmwright.common.processes import use_threads
from swarmwright.controllers.modules.machine import Swarm


class Robots:
    """The robots of several episodes.

    Args:
        episodes: at their start.
        architecture: architecture of the kind `python_modules`.
        weights: (machines, weights).
        owners: the machine of each episode, (episodes,).
    """

    def __init__(
        self,
        episodes: _engine.Episodes,
        architecture: Mapping[str, Any],
        weights: NDArray[np.float32],
        owners: NDArray[np.int64],
    ) -> None:
        self._episodes = episodes
        self._swarm = Swarm(architecture, weights)
        self._owners = owners
        self._each = 0
        """Allocated robots of each episode."""
        self._acted = 0

    @property
    def states(self) -> NDArray[np.int32]:
        """The state of each robot of the only episode that has acted, (robots,)."""
        return self._swarm.current[: self._acted].astype(np.int32)

    def step(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Advance by one step; return the agents that acted, their sensors and their actuators.

        Raises RunError when the code of a module or of the simulation fails.
        """
        episodes, agents, sensors = self._episodes.acting()
        if not np.isfinite(sensors).all():
            agent = agents[~np.isfinite(sensors).all(axis=1)][0]
            raise RunError(f"agent {agent}: its sensors hold a number that is not finite")
        highest = int(agents.max(initial=0)) + 1
        if highest > self._each:
            self._grow(highest)
        self._acted = max(self._acted, highest if len(agents) else 0)
        robots = episodes.astype(np.int64) * self._each + agents
        actuators = self._swarm.step(robots, sensors)
        self._episodes.step(actuators)
        return agents, sensors, actuators

    def _grow(self, each: int) -> None:
        if self._each:
            self._swarm.extend(np.repeat(self._owners, each), self._each, each)
        else:
            self._swarm.restart(np.repeat(self._owners, each))
        self._each = each


class PlayedEpisode:
    """One episode, stepped like the engine's `Episode`.

    Args:
        simulation: its title, or a host.
        parameters: parameters of the simulation.
        seed: seed of the episode.
        specification: specification of the controller, of the kind `python_modules`.

    Raises the engine's errors, and InputError for modules that are not installed.
    """

    def __init__(
        self,
        simulation: Any,  # noqa: ANN401 - as in the engine
        parameters: dict[str, Any],
        seed: int,
        specification: dict[str, Any],
    ) -> None:
        use_threads()
        self._episodes = _engine.Episodes(simulation, parameters, [seed])
        weights = np.array([specification["weights"]], dtype=np.float32)
        self._robots = Robots(self._episodes, specification, weights, np.zeros(1, dtype=np.int64))

    @property
    def done(self) -> bool:
        """Whether the episode has ended."""
        return self._episodes.done

    @property
    def fitness(self) -> float:
        """Fitness so far."""
        return float(self._episodes.fitness()[0])

    def metrics(self, names: list[str]) -> list[float]:
        """Return the named metrics so far."""
        values: list[float] = self._episodes.metrics(names)[0].tolist()
        return values

    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics."""
        return self._episodes.metric_names

    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
        return self._episodes.step_size

    def step(self) -> None:
        """Advance by one step."""
        self.step_observed()

    def step_observed(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Advance by one step; return agents, their sensors and their actuators, see `Episode`."""
        parts = [self._robots.step()]
        while self._episodes.mid_step:
            parts.append(self._robots.step())
        agents, sensors, actuators = (np.concatenate(part) for part in zip(*parts, strict=True))
        return agents, sensors, actuators

    def machine_states(self) -> NDArray[np.int32]:
        """Return the state of each agent that has acted."""
        return self._robots.states

    def scene(self) -> SceneFields:
        """Return the current scene."""
        return self._episodes.scene()

    def scene_arrays(self) -> SceneArrays:
        """Return the current scene as arrays."""
        return self._episodes.scene_arrays()

    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """Return the current scene as text."""
        return self._episodes.text(columns, color, rows, unicode)
