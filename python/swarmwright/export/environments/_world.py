"""What environments of all libraries have in common: an episode, its agents, and how its fitness changes."""

import math
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from gymnasium.spaces import Box
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
"""Of built-in simulations, whose episodes end after some time: metrics that count agents which have ended
before."""
_SEEDS = 2**63
"""Seeds that are drawn are below."""


class World:
    """One simulation, episode after episode."""

    def __init__(
        self,
        simulation: Experiment | Mapping[str, Any] | str | PathLike[str] | type,
        parameters: Mapping[str, Any] | None,
        render_mode: str | None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode: {render_mode!r} found, expected 'rgb_array' or None")
        self.arguments = (simulation, parameters, render_mode)
        """What it was made with."""
        kind = EpisodeSequence if render_mode is None else DrawnEpisodes
        self.episode = kind(simulation, parameters)
        self.experiment = self.episode.experiment
        self._built_in = _built_in(self.experiment.simulation)
        self.render_mode = render_mode
        if not self.episode.actuators:
            raise InputError(
                f"simulation: {self.experiment.simulation} controls its agents itself: nothing acts here"
            )
        self._fitness = 0.0
        # Refused here where there is nothing to draw; Matplotlib takes long, and comes with `picture`.
        if isinstance(self.episode, DrawnEpisodes) and self.episode.picture() is None:
            self.episode.scene()
        acting = self.episode.observe().agents.tolist()
        if not acting:
            raise InputError(
                f"simulation: the episode of {self.experiment.simulation} has ended before its first step "
                "with these parameters; make it longer, and see that it has agents"
            )
        self.names = self._named(len(acting))
        self.frames: dict[str, float] = (
            {"render_fps": 1 / seconds} if (seconds := self.episode.step_seconds) else {}
        )
        """Of the metadata of environments: how fast it is shown."""
        # Only a step tells whether agents act in turn.
        self.episode.step(np.zeros((len(acting), self.episode.actuators), np.float32))
        if self.episode.acts_in_turn or not set(self.episode.observe().agents.tolist()).issubset(acting):
            raise InputError(
                f"simulation: the agents of {self.experiment.simulation} act in turn, those of parallel "
                "environments at the same time; use swarmwright.Episodes"
            )

    def _named(self, count: int) -> list[str]:
        groups = catalogue.groups(self.experiment.simulation, self.experiment.parameters)
        if not groups:
            self._sizes = [(self.episode.sensors, self.episode.actuators)] * count
            self._finishing = count
            return [f"agent_{index}" for index in range(count)]
        self._sizes = [(group.sensors, group.actuators) for group in groups for _ in range(group.agents)]
        self._finishing = groups[0].agents
        return [f"{group.name}_{index}" for group in groups for index in range(group.agents)]

    def spaces(self, agent: int) -> tuple[Box, Box]:
        """Return the spaces of what an agent senses and does."""
        sensors, actuators = self._sizes[agent]
        return (
            Box(-np.inf, np.inf, (sensors,), np.float32),
            Box(-1.0, 1.0, (actuators,), np.float32),
        )

    def reset(self, seed: int | None, generator: np.random.Generator) -> dict[int, NDArray[np.float32]]:
        """Begin an episode; return what the agents sense. generator: of the seed where there is none."""
        chosen = int(generator.integers(_SEEDS)) if seed is None else simulation_seed("seed", seed)
        self.episode.restart(chosen)
        self._fitness = 0.0
        self.last = self._sensed()
        return self.last

    def step(self, actions: Mapping[int, Any]) -> tuple[dict[int, NDArray[np.float32]], float]:
        """Let agents act; return what those sense that act next, and the change of the fitness."""
        agents = self.episode.observe().agents.tolist()
        rows = np.zeros((len(agents), self.episode.actuators), dtype=np.float32)
        for row, agent in zip(rows, agents, strict=True):
            given = float32_of(self.names[agent], actions[agent])
            expected = self._sizes[agent][1]
            if given.shape != (expected,):
                raise InputError(
                    f"{self.names[agent]}: an action of the shape {given.shape} found, expected ({expected},)"
                )
            if not np.isfinite(given).all():
                raise InputError(
                    f"{self.names[agent]}: the action {given.tolist()} found, expected finite numbers"
                )
            row[:expected] = given
        self.episode.step(rows)
        now = self._fitness_now()
        reward, self._fitness = now - self._fitness, now
        if not self.episode.done:
            self.last = {**self.last, **(sensed := self._sensed())}
            return sensed, reward
        return {}, reward

    def _fitness_now(self) -> float:
        """Return the fitness so far: before the end the last one, 0 at first, where it has no value.

        Raises RunError where it has none at the end.
        """
        try:
            values, faults = fitness_and_faults(self.episode)
        except RunError:
            if self.episode.done:
                raise
            return self._fitness
        now = float(values[0])
        if math.isfinite(now):
            return now
        if self.episode.done:
            reason = f"fitness: {faults[0].reason}" if faults else "its fitness is not a finite number"
            raise RunError(f"the episode failed: {reason}")
        return self._fitness

    @property
    def is_truncated(self) -> bool:
        """Whether the episode has ended since its time was over: agents do not sense how much is left."""
        counted = _METRICS_OF_EARLY_ENDS.get(self._built_in)
        if counted is None:
            return self.episode.is_truncated
        if not self.episode.done:
            return False
        metrics = self.episode.metrics
        return sum(float(metrics[name][0]) for name in counted) < self._finishing

    def outcome(self) -> dict[str, Any]:
        """Return what is known at the end of an episode."""
        metrics = {name: float(values[0]) for name, values in self.episode.metrics.items()}
        return {"fitness": self._fitness, "metrics": metrics, "seed": self.episode.seeds[0]}

    def picture(self) -> NDArray[np.uint8] | None:
        """Return what the world looks like, (height, width, 3)."""
        if not isinstance(self.episode, DrawnEpisodes):
            return None
        drawn = self.episode.picture()
        if drawn is not None:
            return drawn
        scene = self.episode.scene()
        recording = Recording((scene,), (self._fitness,), self.episode.step_seconds)
        return np.asarray(Picture(recording, dpi=_DPI).image(scene, 0.0))

    def _sensed(self) -> dict[int, NDArray[np.float32]]:
        seen = self.episode.observe()
        rows = zip(seen.agents.tolist(), seen.sensors, strict=True)
        return {agent: row[: self._sizes[agent][0]].copy() for agent, row in rows}


class OfWorld:
    """An environment of one simulation; its copies, also by pickle, have begun no episode."""

    _world: World

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how another one is made, for copies and other processes."""
        return _of_world, (type(self), *self._world.arguments)


def _of_world(kind: Any, *arguments: Any) -> Any:  # noqa: ANN401 - a class of environments, what its world is of
    return kind(World(*arguments))


def _built_in(simulation: str) -> str | None:
    """Return the built-in simulation whose episodes one has; also those of missions in a class in Python."""
    if is_python(simulation):
        return catalogue.ARENA if catalogue.has_missions(simulation) else None
    return catalogue.find_built_in(simulation)
