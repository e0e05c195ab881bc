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

from swarmwright.common.errors import InputError, SimulationError, explained
from swarmwright.simulations.calls import short
from swarmwright.simulations.environments._environment import (
    Actions,
    Environment,
    actuators,
    check_step,
    environment_seed,
    expected_of_step,
    one_number,
    single,
    with_mask,
)
from swarmwright.simulations.isolation import Apart

_OLD = "Gym before 0.26"
_VECTOR = "derive a class from swarmwright.BatchSimulation, see docs/how-to/own-simulation.md"
_registered: dict[Apart, dict[str, Any]] = {}
"""What the modules of runs' copies have registered."""


class Gymnasium(Environment):
    """A Gymnasium environment; the fitness is the sum of rewards.

        class Pole(Gymnasium):
            environment = "CartPole-v1"

    Sensors and actuators are made of its spaces, see `swarmwright.simulations.environments._environment`.
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
            return gymnasium.make(self._named(), **options)
        except gymnasium.error.UnregisteredEnv as error:
            if ":" in self.environment or "Did you mean" in str(error):
                raise
            raise InputError(
                f"Gymnasium {self.environment}: {explained(error)}; one of another package is named with the "
                f"module that registers it, gymnasium:MODULE:{self.environment}, as in "
                "gymnasium:ale_py:ALE/Pong-v5"
            ) from error
        except gymnasium.error.Error as error:
            known = gymnasium.registry.get(self.environment.rpartition(":")[2])
            if known is None or known.entry_point is not None or known.vector_entry_point is None:
                raise
            raise InputError(
                f"Gymnasium {self.environment}: is registered as a vector of environments only, but one runs "
                f"an episode; {_VECTOR}"
            ) from error

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Go to the start of an episode."""
        self._prepare_episode(parameters)
        self._reward, self._steps, self._terminated, self._over = 0.0, 0, False, False
        try:
            begun = self.env.reset(seed=environment_seed(seed))
        except TypeError as error:
            if "unexpected keyword argument 'seed'" not in str(error):
                raise
            raise SimulationError(
                f"{self.environment}: {error}; expected reset(self, *, seed=None, options=None), which "
                f"{_OLD} did not have"
            ) from error
        # An observation of two numbers would be unpacked as well.
        if not (isinstance(begun, tuple) and len(begun) == 2 and isinstance(begun[1], Mapping)):
            raise SimulationError(
                f"{self.environment}: reset returned {short(begun)}, expected (observation, info), info a "
                f"dict; environments of {_OLD} return the observation alone: return (observation, {{}})"
            )
        return self._seen(begun[0])

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step."""
        seen, reward, terminated, truncated, _ = self._stepped(
            self._act(actions[0].astype(float), self._mask)
        )
        self._steps += 1
        self._reward += single(self.environment, reward, self._steps)
        self._terminated = bool(terminated)
        self._over = bool(terminated or truncated) or self._steps >= self.most_steps
        return self._seen(seen)

    def _seen(self, observation: Any) -> NDArray[np.float64]:  # noqa: ANN401 - of the space's type
        """Return what is sensed, and keep which actions are allowed."""
        sensed = self._read(observation)[None]
        self._mask = self._allowed(observation)
        return sensed

    def done(self) -> bool:
        """Return whether the environment has ended the episode, or it has had all its steps."""
        return self._over

    def fitness(self) -> float:
        """Return the sum of rewards."""
        return self._reward

    def truncated(self) -> bool:
        """Return whether the episode has ended without the environment coming to an end."""
        return self._over and not self._terminated

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {"steps": self._steps, "terminated": float(self._terminated)}

    @contextmanager
    def _modules(self) -> Iterator[None]:
        """Let the copies of a run register environments that others in this process do not see."""
        with super()._modules():
            if self.apart is None:
                yield
                return
            others, before = dict(gymnasium.registry), set(sys.modules)
            gymnasium.registry.update(_registered.get(self.apart, {}))
            try:
                yield
            finally:
                own = {
                    name: spec
                    for name, spec in gymnasium.registry.items()
                    if others.get(name) is not spec and _is_own(spec, self.apart, before)
                }
                _registered[self.apart] = own
                for name in own:
                    if name in others:
                        gymnasium.registry[name] = others[name]
                    else:
                        del gymnasium.registry[name]

    def _try_reward(self) -> None:
        """Make a step, to see that rewards are numbers. Raises InputError where they are not."""
        if self.env.render_mode == "human":  # nothing is shown before an episode
            return
        for _ in range(2):  # the environment checker fails on several rewards
            try:
                seen, _ = self.env.reset(seed=0)
                returned = self.env.step(self._act(np.zeros(self.actuators), self._allowed(seen)))
            except Exception:  # noqa: BLE001, S112 - an episode that fails says so itself, with its line
                continue
            try:
                check_step(self.environment, returned, _OLD)
                one_number(self.environment, returned[1])
            except SimulationError as error:
                raise InputError(f"{type(self).__name__} {error}") from None
            return

    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - an environment
        seen, over = env.reset(seed=seed)[0], False
        yield self._read(seen).tobytes()
        while not over:
            action = self._act(actions(self.actuators), self._allowed(seen))
            seen, reward, terminated, truncated, _ = env.step(action)
            over = bool(terminated or truncated)
            yield self._read(seen).tobytes() + np.asarray(reward, float).tobytes() + bytes([over])

    def _stepped(self, action: Any) -> tuple[Any, ...]:  # noqa: ANN401 - of the space's type
        """Make a step of the environment; return the five values. Raises SimulationError for others."""
        try:
            returned: tuple[Any, ...] = self.env.step(action)
        except ValueError as error:
            # Gymnasium's wrappers unpack what the environment returns.
            if "values to unpack (expected 5" not in str(error):
                raise
            raise SimulationError(f"{self.environment}: {error}: step: {expected_of_step(_OLD)}") from error
        check_step(self.environment, returned, _OLD)
        return returned

    def _sizes(self) -> tuple[int, int]:
        if isinstance(self.env, gymnasium.vector.VectorEnv):
            raise InputError(
                f"{type(self).__name__} {self.environment}: is a vector of {self.env.num_envs} environments, "
                f"but one runs an episode; have make() return one, or {_VECTOR}"
            )
        # An environment that declares none may not have the attributes either.
        observations, actions = (
            getattr(self.env, name, None) for name in ("observation_space", "action_space")
        )
        seen, self._allowed = with_mask(observations, actions, f"{self.environment}: observation_space")
        done = actuators(actions, f"{self.environment}: action_space")
        self._read, self._act = seen.read, done.act
        self.sensor_ranges, self.actuator_ranges = seen.ranges, done.ranges
        return seen.width, done.width


def _is_own(one: Any, apart: Apart, before: set[str]) -> bool:  # noqa: ANN401 - an EnvSpec
    """Return whether a copy has registered an environment, and not a package that it was first to import.

    Packages that were there before have registered theirs already, so that a new one of them is a variant
    that the copy makes; before: the modules that were there.
    """
    entry = one.entry_point or one.vector_entry_point
    module = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", None)
    top = str(module).partition(".")[0]
    return top in apart.names or top in before
