"""Simulations with one agent as environments of Gymnasium.

Source: https://gymnasium.farama.org/api/env/
"""

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from swarmwright.common.arguments import simulation_seed
from swarmwright.common.errors import InputError
from swarmwright.export.environments._world import World, WorldEnv


class AgentEnv(WorldEnv, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A simulation with one agent as an environment; see `gymnasium_env`, which creates it."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as in the base class

    def __init__(self, world: World) -> None:
        self._world = world
        if len(self._world.names) != 1:
            raise InputError(
                f"simulation: {self._world.experiment.simulation} has {len(self._world.names)} agents; "
                "use parallel_env"
            )
        self.metadata = {**self.metadata, **world.frames}
        self.render_mode = world.render_mode
        sensors, actuators = self._world.spaces(0)
        self.observation_space = cast("Space[NDArray[np.float32]]", sensors)
        self.action_space = cast("Space[NDArray[np.float32]]", actuators)
        self._going = False

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode with a seed, or with one drawn from `np_random`."""
        if seed is not None:
            simulation_seed("seed", seed)  # validate it before the base class uses it
        super().reset(seed=seed, options=options)
        sensed = self._world.reset(seed, self.np_random)[0]
        self._going = True
        return sensed, {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Let the agent act."""
        if not self._going:
            raise InputError("step: no episode is running; call reset() first")
        sensed, reward = self._world.step({0: action})
        self._going = bool(sensed)
        info = {} if self._going else self._world.outcome()
        cut = self._world.is_truncated
        return self._world.last[0], reward, not (self._going or cut), cut, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture, (height, width, 3); None without `render_mode`."""
        return self._world.picture()
