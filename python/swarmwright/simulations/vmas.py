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
from swarmwright.common.ranges import intersect_ranges
from swarmwright.common.tracebacks import locate_error
from swarmwright.simulations.base import BatchSimulation
from swarmwright.simulations.environments._environment import check_paths, environment_seed, ranges


class Vmas(BatchSimulation):
    """A scenario with continuous actions; the fitness is the mean over agents of each one's sum of rewards.

    The same controller controls all agents, so they must have the same sensors and actuators. Actuators are
    scaled to the ranges of the agents. Parameters of an experiment go to the scenario; `max_steps` ends an
    episode, after 100 steps by default. If a scenario draws random numbers during its steps, such as noise,
    or for all episodes at once, as road_traffic does, an episode depends on the others in its batch, so
    results differ between the evaluation modes.
    """

    environment: ClassVar[str] = ""
    """The scenario's name."""
    options: ClassVar[Mapping[str, Any]] = {}
    """Arguments of the scenario; parameters of an experiment are added."""
    adapted: ClassVar[str] = ""

    lanes = 512

    def __init__(self) -> None:
        self._ensure_environment(1, {})
        self.sensors, self.actuators = self._sizes(self._env)

    def configure(self, parameters: dict[str, Any]) -> Self:
        """Apply parameters and return this object. Raises InputError if they are not accepted."""
        self._ensure_environment(1, parameters)
        return self

    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Start an episode for each seed."""
        if (len(seeds), parameters) != self._made_for:
            self._ensure_environment(len(seeds), parameters)
            if self._sizes(self._env) != (self.sensors, self.actuators):
                raise InputError(
                    f"{', '.join(parameters)}: changes the sensors or actuators of agents; put it into the "
                    f"simulation's name, as in {self.environment}?{next(iter(parameters))}=.."
                )
        for index, seed in enumerate(seeds.tolist()):
            # VMAS has a single generator; seeding it keeps the start of an episode independent of the others.
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
        tensors = [torch.as_tensor(_scale_actions(actions[:, index], space)) for index, space in spaces]
        observations, rewards, dones, _ = self._env.step(tensors)
        # Some scenarios return columns, (episodes, 1).
        gained = np.stack([np.asarray(reward, float).reshape(len(actions)) for reward in rewards], axis=1)
        self._rewards += np.where(self._over, 0.0, gained.sum(axis=1) / len(rewards))
        self._over = self._over | np.asarray(dones, bool).reshape(len(actions))
        return self._rows(observations)

    def done(self) -> NDArray[np.bool_]:
        """Return which episodes have ended."""
        return self._over

    def fitness(self) -> NDArray[np.float64]:
        """Return the mean over agents of the sum of rewards."""
        return self._rewards

    def _ensure_environment(self, episodes: int, parameters: dict[str, Any]) -> None:
        """Create the scenario for this number of episodes. Raises InputError."""
        self._env = self._make(episodes, parameters)
        self._made_for = (episodes, dict(parameters))
        self.actuator_ranges = intersect_ranges(
            [ranges(*_middle_and_half(space)) for space in self._env.action_space]
        )

    def _make(self, episodes: int, parameters: dict[str, Any]) -> Any:  # noqa: ANN401 - a type of VMAS
        check_paths(f"Vmas {self.environment}", self.environment, parameters)
        options = {"max_steps": 100, **self.options, **parameters}
        try:
            with warnings.catch_warnings():
                # VMAS reports unknown parameters with this warning.
                warnings.filterwarnings("error", message="Scenario kwargs")
                return vmas.make_env(
                    scenario=self.environment,
                    num_envs=episodes,
                    device="cpu",
                    continuous_actions=True,
                    **options,
                )
        except Exception as error:  # libraries raise various exceptions
            where = f"{', '.join(parameters)}: " if parameters else ""
            raise InputError(f"{where}Vmas {self.environment}: {locate_error(error)}") from error

    def _sizes(self, env: Any) -> tuple[int, int]:  # noqa: ANN401 - a type of VMAS
        sensor_shapes = {space.shape for space in env.observation_space}
        actuator_shapes = {space.shape for space in env.action_space}
        if None in sensor_shapes:
            raise InputError(f"Vmas {self.environment}: its observations are dictionaries, expected arrays")
        if len(sensor_shapes) != 1 or len(actuator_shapes) != 1:
            raise InputError(
                f"Vmas {self.environment}: its agents have different spaces, so they cannot share a "
                "controller"
            )
        return int(np.prod(sensor_shapes.pop())), int(np.prod(actuator_shapes.pop()))

    def _rows(self, observations: Any) -> NDArray[np.float64]:  # noqa: ANN401 - tensors, one for each agent
        return np.stack([np.asarray(rows, float) for rows in observations], axis=1)


def _scale_actions(actions: NDArray[np.float32], space: Any) -> NDArray[np.float32]:  # noqa: ANN401 - one of gym's
    """Scale -1..1 to the range of each actuator, (episodes, actuators)."""
    middle, half = _middle_and_half(space)
    scaled: NDArray[np.float32] = np.clip(middle + half * actions, space.low, space.high)
    return scaled


def _middle_and_half(space: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]]:  # noqa: ANN401 - one of gym's
    """Return the middle of each actuator's range and half its width."""
    return (space.high + space.low) / 2, (space.high - space.low) / 2
