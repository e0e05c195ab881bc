"""Episodes of the engine, and machines in Python for their robots."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import RunError
from swarmwright.controllers.modules.machine import Swarm


class Robots:
    """The robots of some episodes.

    Args:
        episodes: at their start.
        architecture: of the kind `python_modules`.
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
        """Robots of an episode, for which there is a place."""
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
