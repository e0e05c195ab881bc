"""Scenarios of VMAS as simulations, many episodes at once.

Source: Bettini, Kortvelesy, Blumenkamp, Prorok, VMAS: A vectorized multi-agent simulator for collective robot
learning, DARS 2022, https://github.com/proroklab/VectorizedMultiAgentSimulator.
"""

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
import torch
import vmas
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.ranges import common
from swarmwright.common.tracebacks import located
from swarmwright.simulations.base import BatchSimulation
from swarmwright.simulations.environments._environment import check_paths, environment_seed, ranges


class Vmas(BatchSimulation):
    """A scenario with continuous actions; the fitness is the mean over agents of each one's sum of rewards.

    All agents are steered by the same controller, so they must sense and act alike. Actuators are scaled to
    the ranges of agents. Parameters of an experiment go to the scenario; `max_steps` ends an episode, after
    100 steps by default. Where a scenario draws random numbers in its steps, for noise, or for all episodes
    at once, as road_traffic does, an episode depends on those beside it, and the modes differ.
    """

    environment: ClassVar[str] = ""
    """The scenario's name."""
    options: ClassVar[Mapping[str, Any]] = {}
    """What the scenario gets; parameters of an experiment are added."""
    adapted: ClassVar[str] = ""

    lanes = 512

    def __init__(self) -> None:
        self._ensure_environment(1, {})
        self.sensors, self.actuators = self._sizes(self._env)

    def described_with(self, parameters: dict[str, Any]) -> Self:
        """Return this object with what it announces with these parameters. Raises InputError."""
        self._ensure_environment(1, parameters)
        return self

    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Go to the start of an episode for each seed."""
        if (len(seeds), parameters) != self._made_of:
            self._ensure_environment(len(seeds), parameters)
            if self._sizes(self._env) != (self.sensors, self.actuators):
                raise InputError(
                    f"{', '.join(parameters)}: changes what agents sense; put it into the simulation's name, "
                    f"as {self.environment}?{next(iter(parameters))}=.."
                )
        for index, seed in enumerate(seeds.tolist()):
            # The random numbers of an episode are independent of the others; VMAS keeps one generator.
            self._env.seed(environment_seed(seed))
            self._env.reset_at(index, return_observations=False)
        self._rewards = np.zeros(len(seeds))
        self._over = np.zeros(len(seeds), bool)
        return self._rows(
            self._env.get_from_scenario(
                get_observations=True, get_rewards=False, get_infos=False, get_dones=False
            )[0]
        )

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step."""
        spaces = enumerate(self._env.action_space)
        given = [torch.as_tensor(_scaled(actions[:, index], space)) for index, space in spaces]
        seen, rewards, dones, _ = self._env.step(given)
        # Some scenarios give columns, of one number each.
        gained = np.stack([np.asarray(reward, float).reshape(len(actions)) for reward in rewards], axis=1)
        self._rewards += np.where(self._over, 0.0, gained.sum(axis=1) / len(rewards))
        self._over = self._over | np.asarray(dones, bool).reshape(len(actions))
        return self._rows(seen)

    def done(self) -> NDArray[np.bool_]:
        """Return which episodes have ended."""
        return self._over

    def fitness(self) -> NDArray[np.float64]:
        """Return the mean over agents of the sum of rewards."""
        return self._rewards

    def _ensure_environment(self, episodes: int, parameters: dict[str, Any]) -> None:
        """Have a scenario for so many episodes. Raises InputError."""
        self._env = self._make(episodes, parameters)
        self._made_of = (episodes, dict(parameters))
        self.actuator_ranges = common([ranges(*_middle_and_half(space)) for space in self._env.action_space])

    def _make(self, episodes: int, parameters: dict[str, Any]) -> Any:  # noqa: ANN401 - a type of VMAS
        check_paths(f"Vmas {self.environment}", self.environment, parameters)
        given = {"max_steps": 100, **self.options, **parameters}
        try:
            with warnings.catch_warnings():
                # VMAS reports an unknown parameter in this way.
                warnings.filterwarnings("error", message="Scenario kwargs")
                return vmas.make_env(
                    scenario=self.environment,
                    num_envs=episodes,
                    device="cpu",
                    continuous_actions=True,
                    **given,
                )
        except Exception as error:  # libraries raise various exceptions
            where = f"{', '.join(parameters)}: " if parameters else ""
            raise InputError(f"{where}Vmas {self.environment}: {located(error)}") from error

    def _sizes(self, env: Any) -> tuple[int, int]:  # noqa: ANN401 - a type of VMAS
        seen = {space.shape for space in env.observation_space}
        acts = {space.shape for space in env.action_space}
        if None in seen:
            raise InputError(f"Vmas {self.environment}: its observations are dictionaries, not numbers")
        if len(seen) != 1 or len(acts) != 1:
            raise InputError(
                f"Vmas {self.environment}: its agents differ, so one controller cannot steer all"
            )
        return int(np.prod(seen.pop())), int(np.prod(acts.pop()))

    def _rows(self, seen: Any) -> NDArray[np.float64]:  # noqa: ANN401 - tensors, one for each agent
        return np.stack([np.asarray(rows, float) for rows in seen], axis=1)


def _scaled(actions: NDArray[np.float32], space: Any) -> NDArray[np.float32]:  # noqa: ANN401 - one of gym's
    """Scale -1..1 to the range of each actuator, (episodes, actuators)."""
    middle, half = _middle_and_half(space)
    scaled: NDArray[np.float32] = np.clip(middle + half * actions, space.low, space.high)
    return scaled


def _middle_and_half(space: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]]:  # noqa: ANN401 - one of gym's
    """Return the middle of each actuator's range and half its width."""
    return (space.high + space.low) / 2, (space.high - space.low) / 2
