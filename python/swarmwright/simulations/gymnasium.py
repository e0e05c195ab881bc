"""Gymnasium's environments as simulations: a swarm of one agent.

Source: https://gymnasium.farama.org
"""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, SimulationError, describe_exception
from swarmwright.simulations.calls import summarize
from swarmwright.simulations.environments._environment import (
    Actions,
    Environment,
    actuators,
    check_step,
    describe_step_result,
    environment_seed,
    parse_reward,
    single,
    with_mask,
)
from swarmwright.simulations.isolation import IsolatedModules

_OLD = "Gym before 0.26"
_VECTOR = "derive a class from swarmwright.BatchSimulation, see docs/how-to/own-simulation.md"
_registered: dict[IsolatedModules, dict[str, Any]] = {}
"""Environments that the modules of runs' copies have registered."""


class Gymnasium(Environment):
    """A Gymnasium environment; the fitness is the sum of rewards.

        class Pole(Gymnasium):
            environment = "CartPole-v1"

    Sensors and actuators follow from its spaces, see `swarmwright.simulations.environments._environment`.
    """

    metrics = {  # noqa: RUF012 - as in the base class
        "steps": "Steps of the episode.",
        "terminated": "1 if the environment terminated, 0 if the time was over.",
    }

    def __init__(self) -> None:
        super().__init__()
        self._try_reward()

    def make(self, options: dict[str, Any]) -> "gymnasium.Env[Any, Any]":
        """Return a new environment; override it to add wrappers."""
        try:
            return gymnasium.make(self._environment_name(), **options)
        except gymnasium.error.UnregisteredEnv as error:
            if ":" in self.environment or "Did you mean" in str(error):
                raise
            raise InputError(
                f"Gymnasium {self.environment}: {describe_exception(error)}; if it belongs to another "
                "package, name "
                f"the module that registers it, gymnasium:MODULE:{self.environment}, as in "
                "gymnasium:ale_py:ALE/Pong-v5"
            ) from error
        except gymnasium.error.Error as error:
            spec = gymnasium.registry.get(self.environment.rpartition(":")[2])
            if spec is None or spec.entry_point is not None or spec.vector_entry_point is None:
                raise
            raise InputError(
                f"Gymnasium {self.environment}: is registered only as a vector of environments, but an "
                f"episode runs in a single one; {_VECTOR}"
            ) from error

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Start an episode."""
        self._prepare_episode(parameters)
        self._reward, self._steps, self._terminated, self._over = 0.0, 0, False, False
        try:
            result = self.env.reset(seed=environment_seed(seed))
        except TypeError as error:
            if "unexpected keyword argument 'seed'" not in str(error):
                raise
            raise SimulationError(
                f"{self.environment}: {error}; expected reset(self, *, seed=None, options=None), which "
                f"{_OLD} did not have"
            ) from error
        # An observation of two numbers would be unpacked as well.
        if not (isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], Mapping)):
            raise SimulationError(
                f"{self.environment}: reset returned {summarize(result)}, expected (observation, info) with "
                f"a dict as info; environments of {_OLD} return the observation alone: return (observation, "
                f"{{}})"
            )
        return self._sense(result[0])

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step."""
        observation, reward, terminated, truncated, _ = self._step_environment(
            self._act(actions[0].astype(float), self._mask)
        )
        self._steps += 1
        self._reward += single(self.environment, reward, self._steps)
        self._terminated = bool(terminated)
        self._over = bool(terminated or truncated) or self._steps >= self.most_steps
        return self._sense(observation)

    def _sense(self, observation: Any) -> NDArray[np.float64]:  # noqa: ANN401 - of the space's type
        """Return the sensor values, and store the action mask."""
        sensed = self._read(observation)[None]
        self._mask = self._allowed(observation)
        return sensed

    def done(self) -> bool:
        """Return whether the environment has ended the episode, or the step limit is reached."""
        return self._over

    def fitness(self) -> float:
        """Return the sum of rewards."""
        return self._reward

    def truncated(self) -> bool:
        """Return whether the episode has ended before the environment terminated."""
        return self._over and not self._terminated

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {"steps": self._steps, "terminated": float(self._terminated)}

    @contextmanager
    def _modules(self) -> Iterator[None]:
        """Let the copies of a run register environments that the rest of the process does not see."""
        with super()._modules():
            if self.isolated_modules is None:
                yield
                return
            registry_before, modules_before = dict(gymnasium.registry), set(sys.modules)
            gymnasium.registry.update(_registered.get(self.isolated_modules, {}))
            try:
                yield
            finally:
                registered = {
                    name: spec
                    for name, spec in gymnasium.registry.items()
                    if registry_before.get(name) is not spec
                    and _is_registered_by_copy(spec, self.isolated_modules, modules_before)
                }
                _registered[self.isolated_modules] = registered
                for name in registered:
                    if name in registry_before:
                        gymnasium.registry[name] = registry_before[name]
                    else:
                        del gymnasium.registry[name]

    def _try_reward(self) -> None:
        """Make a step. Raises InputError if its reward is not a number."""
        if self.env.render_mode == "human":  # no window before the first episode
            return
        for _ in range(2):  # the environment checker fails in the first step if rewards are arrays
            try:
                observation, _ = self.env.reset(seed=0)
                returned = self.env.step(self._act(np.zeros(self.actuators), self._allowed(observation)))
            except Exception:  # noqa: BLE001, S112 - episodes report failures with their line
                continue
            try:
                check_step(self.environment, returned, _OLD)
                parse_reward(self.environment, returned[1])
            except SimulationError as error:
                raise InputError(f"{type(self).__name__} {error}") from None
            return

    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - an environment
        observation, over = env.reset(seed=seed)[0], False
        yield self._read(observation).tobytes()
        while not over:
            action = self._act(actions(self.actuators), self._allowed(observation))
            observation, reward, terminated, truncated, _ = env.step(action)
            over = bool(terminated or truncated)
            yield self._read(observation).tobytes() + np.asarray(reward, float).tobytes() + bytes([over])

    def _step_environment(self, action: Any) -> tuple[Any, ...]:  # noqa: ANN401 - of the space's type
        """Step the environment. Raises SimulationError unless it returns five values."""
        try:
            returned: tuple[Any, ...] = self.env.step(action)
        except ValueError as error:
            # Gymnasium's wrappers unpack what the environment returns.
            if "values to unpack (expected 5" not in str(error):
                raise
            raise SimulationError(
                f"{self.environment}: {error}: step: {describe_step_result(_OLD)}"
            ) from error
        check_step(self.environment, returned, _OLD)
        return returned

    def _sizes(self) -> tuple[int, int]:
        if isinstance(self.env, gymnasium.vector.VectorEnv):
            raise InputError(
                f"{type(self).__name__} {self.environment}: is a vector of {self.env.num_envs} environments, "
                f"but an episode runs in a single one; return a single one from make(), or {_VECTOR}"
            )
        # Environments without spaces may lack the attributes, too.
        observations, actions = (
            getattr(self.env, name, None) for name in ("observation_space", "action_space")
        )
        inputs, self._allowed = with_mask(observations, actions, f"{self.environment}: observation_space")
        outputs = actuators(actions, f"{self.environment}: action_space")
        self._read, self._act = inputs.read, outputs.act
        self.sensor_ranges, self.actuator_ranges = inputs.ranges, outputs.ranges
        return inputs.width, outputs.width


def _is_registered_by_copy(spec: Any, isolated_modules: IsolatedModules, modules_before: set[str]) -> bool:  # noqa: ANN401 - an EnvSpec
    """Return whether a run's copy has registered an environment, not a package that it imported first.

    modules_before: names of the modules that were already imported. They have registered their environments
    before, so a new entry with one of them is a variant that the copy registers.
    """
    entry = spec.entry_point or spec.vector_entry_point
    module = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", None)
    top = str(module).partition(".")[0]
    return top in isolated_modules.names or top in modules_before
