"""Shared part of the environments: an episode, its agents, and the changes of its fitness."""

import math
from collections.abc import Mapping
from os import PathLike
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from swarmwright.common.arguments import simulation_seed
from swarmwright.common.arrays import float32_of
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.simulation_names import is_python
from swarmwright.display import Recording
from swarmwright.display.drawing import Picture
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.episodes import DrawnEpisodes, EpisodeSequence, fitness_and_faults
from swarmwright.simulations import catalogue

_DPI = 80
_METRICS_OF_EARLY_ENDS: Mapping[str | None, tuple[str, ...]] = {
    catalogue.ARENA: (),
    "emergency_exit": ("out",),
    "minisim": ("arrived", "caught"),
}
"""Metrics of built-in simulations that count agents that ended before the time limit."""
_SEEDS = 2**63
"""Upper bound of drawn seeds."""


class World:
    """A simulation, episode after episode."""

    def __init__(
        self,
        simulation: Experiment | Mapping[str, Any] | str | PathLike[str] | type,
        parameters: Mapping[str, Any] | None,
        render_mode: str | None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode: {render_mode!r} found, expected 'rgb_array' or None")
        self.arguments = (simulation, parameters, render_mode)
        """Arguments of the constructor."""
        kind = EpisodeSequence if render_mode is None else DrawnEpisodes
        self.episode = kind(simulation, parameters)
        self.experiment = self.episode.experiment
        self._built_in = _find_built_in(self.experiment.simulation)
        self.render_mode = render_mode
        if not self.episode.actuators:
            raise InputError(
                f"simulation: {self.experiment.simulation} controls its agents itself, so there are no "
                "actions"
            )
        self._fitness = 0.0
        # Fail early if there is nothing to draw; Matplotlib is imported later, in `picture`.
        if isinstance(self.episode, DrawnEpisodes) and self.episode.picture() is None:
            self.episode.scene()
        acting = self.episode.observe().agents.tolist()
        if not acting:
            raise InputError(
                f"simulation: the episode of {self.experiment.simulation} ends before its first step with "
                "these parameters; make it longer, and check that it has agents"
            )
        self.names = self._name_agents(len(acting))
        self.frames: dict[str, float] = (
            {"render_fps": 1 / seconds} if (seconds := self.episode.step_seconds) else {}
        )
        """Frame rate for the metadata of environments."""
        # Whether agents act in turn is known after a step.
        self.episode.step(np.zeros((len(acting), self.episode.actuators), np.float32))
        if self.episode.acts_in_turn or not set(self.episode.observe().agents.tolist()).issubset(acting):
            raise InputError(
                f"simulation: the agents of {self.experiment.simulation} act in turn, but parallel "
                "environments need simultaneous actions; use swarmwright.Episodes"
            )

    def _name_agents(self, count: int) -> list[str]:
        groups = catalogue.groups(self.experiment.simulation, self.experiment.parameters)
        if not groups:
            self._sizes = [(self.episode.sensors, self.episode.actuators)] * count
            self._finishing = count
            return [f"agent_{index}" for index in range(count)]
        self._sizes = [(group.sensors, group.actuators) for group in groups for _ in range(group.agents)]
        self._finishing = groups[0].agents
        return [f"{group.name}_{index}" for group in groups for index in range(group.agents)]

    def spaces(self, agent: int) -> tuple[Box, Box]:
        """Return the observation space and the action space of an agent."""
        sensors, actuators = self._sizes[agent]
        return (
            Box(-np.inf, np.inf, (sensors,), np.float32),
            Box(-1.0, 1.0, (actuators,), np.float32),
        )

    def reset(self, seed: int | None, generator: np.random.Generator) -> dict[int, NDArray[np.float32]]:
        """Begin an episode; return the sensors of agents. generator: draws the seed if it is None."""
        chosen = int(generator.integers(_SEEDS)) if seed is None else simulation_seed("seed", seed)
        self.episode.restart(chosen)
        self._fitness = 0.0
        self.last = self._observe()
        return self.last

    def step(self, actions: Mapping[int, Any]) -> tuple[dict[int, NDArray[np.float32]], float]:
        """Let agents act; return the sensors of those that act next, and the change of the fitness."""
        agents = self.episode.observe().agents.tolist()
        rows = np.zeros((len(agents), self.episode.actuators), dtype=np.float32)
        for row, agent in zip(rows, agents, strict=True):
            action = float32_of(self.names[agent], actions[agent])
            expected = self._sizes[agent][1]
            if action.shape != (expected,):
                raise InputError(
                    f"{self.names[agent]}: an action of the shape {action.shape} found, expected "
                    f"({expected},)"
                )
            if not np.isfinite(action).all():
                raise InputError(
                    f"{self.names[agent]}: the action {action.tolist()} found, expected finite numbers"
                )
            row[:expected] = action
        self.episode.step(rows)
        fitness = self._current_fitness()
        reward, self._fitness = fitness - self._fitness, fitness
        if not self.episode.done:
            self.last = {**self.last, **(sensed := self._observe())}
            return sensed, reward
        return {}, reward

    def _current_fitness(self) -> float:
        """Return the present fitness; if it has no value, the previous one, initially 0.

        Raises RunError if there is no value at the end.
        """
        try:
            values, faults = fitness_and_faults(self.episode)
        except RunError:
            if self.episode.done:
                raise
            return self._fitness
        fitness = float(values[0])
        if math.isfinite(fitness):
            return fitness
        if self.episode.done:
            reason = f"fitness: {faults[0].reason}" if faults else "its fitness is not a finite number"
            raise RunError(f"the episode failed: {reason}")
        return self._fitness

    @property
    def is_truncated(self) -> bool:
        """Whether the episode has ended because its time was over, which agents cannot sense."""
        counted = _METRICS_OF_EARLY_ENDS.get(self._built_in)
        if counted is None:
            return self.episode.is_truncated
        if not self.episode.done:
            return False
        metrics = self.episode.metrics
        return sum(float(metrics[name][0]) for name in counted) < self._finishing

    def outcome(self) -> dict[str, Any]:
        """Return fitness, metrics and seed at the end of an episode."""
        metrics = {name: float(values[0]) for name, values in self.episode.metrics.items()}
        return {"fitness": self._fitness, "metrics": metrics, "seed": self.episode.seeds[0]}

    def picture(self) -> NDArray[np.uint8] | None:
        """Return a picture of the world, (height, width, 3)."""
        if not isinstance(self.episode, DrawnEpisodes):
            return None
        drawn = self.episode.picture()
        if drawn is not None:
            return drawn
        scene = self.episode.scene()
        recording = Recording((scene,), (self._fitness,), self.episode.step_seconds)
        return np.asarray(Picture(recording, dpi=_DPI).image(scene, 0.0))

    def _observe(self) -> dict[int, NDArray[np.float32]]:
        observation = self.episode.observe()
        rows = zip(observation.agents.tolist(), observation.sensors, strict=True)
        return {agent: row[: self._sizes[agent][0]].copy() for agent, row in rows}


class WorldEnv:
    """Base class of environments; copies, also by pickle, start without an episode."""

    _world: World

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor and its arguments, for copies and other processes."""
        return _create_environment, (type(self), *self._world.arguments)


def _create_environment(kind: Any, *arguments: Any) -> Any:  # noqa: ANN401 - a class of environments, arguments of its world
    return kind(World(*arguments))


def _find_built_in(simulation: str) -> str | None:
    """Return the built-in simulation of a name, also for missions in a Python class."""
    if is_python(simulation):
        return catalogue.ARENA if catalogue.has_missions(simulation) else None
    return catalogue.find_built_in(simulation)


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
