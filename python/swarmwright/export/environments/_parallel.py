"""Simulations as parallel environments of PettingZoo.

Source: https://pettingzoo.farama.org/api/parallel/
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from swarmwright.common.arguments import simulation_seed
from swarmwright.common.errors import InputError
from swarmwright.export.environments._world import World, WorldEnv

_Sensed = dict[str, NDArray[np.float32]]


class SwarmEnv(WorldEnv, ParallelEnv):  # type: ignore[misc] # PettingZoo has no types
    """A simulation as a parallel environment; see `parallel_env`, which creates it."""

    metadata = {"render_modes": ["rgb_array"], "is_parallelizable": True}  # noqa: RUF012 - as in the base class

    def __init__(self, world: World) -> None:
        self._world = world
        self.render_mode = world.render_mode
        self.metadata = {**self.metadata, **world.frames, "name": self._world.experiment.label}
        self.possible_agents = list(self._world.names)
        self.agents: list[str] = []
        self._begun = False
        self._generator: np.random.Generator | None = None
        self._numbers = {name: number for number, name in enumerate(self.possible_agents)}
        spaces = [self._world.spaces(number) for number in range(len(self.possible_agents))]
        self.observation_spaces = {
            name: space[0] for name, space in zip(self.possible_agents, spaces, strict=True)
        }
        self.action_spaces = {
            name: space[1] for name, space in zip(self.possible_agents, spaces, strict=True)
        }

    def observation_space(self, agent: str) -> Box:
        """Return the observation space of an agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Return the action space of an agent, always the same object."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - as in PettingZoo
    ) -> tuple[_Sensed, dict[str, dict[str, Any]]]:
        """Begin an episode with a seed, or with one drawn from the generator of the last seed."""
        if seed is not None or self._generator is None:
            self._generator = np.random.default_rng(None if seed is None else simulation_seed("seed", seed))
        sensed = self._key_by_name(self._world.reset(seed, self._generator))
        self._begun = True
        self.agents = list(sensed)
        return sensed, {name: {} for name in self.agents}

    def step(
        self, actions: dict[str, NDArray[np.float32]]
    ) -> tuple[_Sensed, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Let all agents act. Without agents, at the end, do nothing, as in PettingZoo's conversions."""
        if not self._begun:
            raise InputError("step: no episode has begun; call reset() first")
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [name for name in self.agents if name not in actions]
        if missing:
            raise InputError(f"actions: missing for {', '.join(missing)}")
        before = self.agents
        sensed, reward = self._world.step({self._numbers[name]: actions[name] for name in before})
        last = self._key_by_name(self._world.last)
        self.agents = [name for name in before if self._numbers[name] in sensed]
        info = {} if self.agents else self._world.outcome()
        cut = self._world.is_truncated
        return (
            {name: last[name] for name in before},
            dict.fromkeys(before, reward),
            {name: name not in self.agents and not cut for name in before},
            dict.fromkeys(before, cut),
            {name: dict(info) for name in before},
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture, (height, width, 3); None without `render_mode`."""
        return self._world.picture()

    def _key_by_name(self, sensed: Mapping[int, NDArray[np.float32]]) -> _Sensed:
        return {self._world.names[number]: row for number, row in sensed.items()}
