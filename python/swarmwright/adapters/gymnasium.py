"""Gymnasium's environments as simulations: a swarm of one agent.

Source: https://gymnasium.farama.org
"""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarmwright.adapters._environment import Environment, environment_seed
from swarmwright.adapters._spaces import actuators, sensors
from swarmwright.core.errors import InputError, SimulationError, explained
from swarmwright.simulations.calls import short


class Gymnasium(Environment):
    """A Gymnasium environment; the fitness is the sum of rewards.

        class Pole(Gymnasium):
            environment = "CartPole-v1"

    Sensors and actuators are made of its spaces, see `swarmwright.adapters._spaces`.
    """

    metrics = {  # noqa: RUF012 - as in the base class
        "steps": "Steps of the episode.",
        "terminated": "1 if the environment came to an end, 0 if the time was over.",
    }

    def __init__(self) -> None:
        super().__init__()
        self._try_reward()

    def make(self, options: dict[str, Any]) -> "gymnasium.Env[Any, Any]":
        """Return a new environment; override it to add wrappers."""
        try:
            return gymnasium.make(self.environment, **options)
        except gymnasium.error.UnregisteredEnv as error:
            if ":" in self.environment or "Did you mean" in str(error):
                raise
            raise InputError(
                f"Gymnasium {self.environment}: {explained(error)}; one of another package is named with the "
                f"module that registers it, gymnasium:MODULE:{self.environment}, as in "
                "gymnasium:ale_py:ALE/Pong-v5"
            ) from error

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Go to the start of an episode."""
        self._start(parameters)
        self._reward, self._steps, self._terminated, self._over = 0.0, 0, False, False
        begun = self.env.reset(seed=environment_seed(seed))
        # An observation of two numbers would be unpacked as well.
        if not (isinstance(begun, tuple) and len(begun) == 2 and isinstance(begun[1], Mapping)):
            raise SimulationError(
                f"{self.environment}: reset returned {short(begun)}, expected (observation, info), info a "
                "dict; environments of Gym before 0.26 return the observation alone: return (observation, {})"
            )
        return self._read(begun[0])[None]

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Go on by one step."""
        seen, reward, terminated, truncated, _ = self.env.step(self._act(actions[0].astype(float)))
        self._reward += self._single(reward)
        self._steps += 1
        self._terminated = bool(terminated)
        self._over = bool(terminated or truncated) or self._steps >= self.most_steps
        return self._read(seen)[None]

    def done(self) -> bool:
        """Return whether the environment has ended the episode, or it has had all its steps."""
        return self._over

    def fitness(self) -> float:
        """Return the sum of rewards."""
        return self._reward

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {"steps": self._steps, "terminated": float(self._terminated)}

    def _try_reward(self) -> None:
        """Make a step, to see that rewards are numbers. Raises InputError where they are not."""
        if self.env.render_mode == "human":  # nothing is shown before an episode
            return
        for _ in range(2):  # the environment checker fails on several rewards
            try:
                self.env.reset(seed=0)
                _, reward, _, _, _ = self.env.step(self._act(np.zeros(self.actuators)))
            except Exception:  # noqa: BLE001, S112 - an episode that fails says so itself, with its line
                continue
            try:
                self._single(reward)
            except SimulationError as error:
                raise InputError(f"{type(self).__name__} {error}") from None
            return

    def _single(self, reward: Any) -> float:  # noqa: ANN401 - whatever an environment returns
        """Return a reward as one number. Raises SimulationError for several, as in multi-objective tasks."""
        if np.ndim(reward) == 0 or np.size(reward) == 1:
            return float(np.asarray(reward, float).item())
        raise SimulationError(
            f"{self.environment}: its reward has {np.size(reward)} numbers, a fitness is one; weigh them in "
            "a custom class whose make() adds a wrapper such as mo_gymnasium.wrappers.LinearReward"
        )

    def _sizes(self) -> tuple[int, int]:
        seen = sensors(self.env.observation_space, f"{self.environment}: observation_space")
        done = actuators(self.env.action_space, f"{self.environment}: action_space")
        self._read, self._act = seen.read, done.act
        return seen.width, done.width
