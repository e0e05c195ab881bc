"""Sensors, actuators and controller states of agents over an episode, and metrics over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import RunError, engine_errors

MOST_NUMBERS = 30_000_000
"""Largest number of sensor and actuator values of an episode (120 MB). With more agents, only the first are
recorded."""


MOST_STATE = 254
"""Largest recorded state number; larger states are recorded as this number."""


def fill_states(recorded: NDArray[np.signedinteger[Any]], agents: int) -> NDArray[np.int32]:
    """Return the states of all agents, including those that have not acted yet."""
    states = np.zeros(max(agents, len(recorded)), dtype=np.int32)
    states[len(recorded) :] = -1 if len(recorded) and recorded[-1] < 0 else 0
    states[: len(recorded)] = recorded
    return states


@dataclass(frozen=True)
class Trace:
    """Record of each agent at each step; S steps, A recorded agents, which are the first.

    sensors: (S, A, sensors), before each step; NaN for agents that did not act. actuators: (S, A, actuators),
    of each step. states: (S + 1, all agents), current state of each agent's state machine, at most 254; -1
    for agents whose controller has no states; None if no controller has. metrics: names -> (S + 1,), NaN if
    unknown.
    """

    sensors: NDArray[np.float32]
    actuators: NDArray[np.float32]
    states: NDArray[np.int16] | None
    metrics: dict[str, NDArray[np.float64]]


class Tracer:
    """Steps an episode and records sensors and actuators."""

    def __init__(self, episode: Any, metrics: Sequence[str]) -> None:  # noqa: ANN401 - see `from_episode`
        self._episode = episode
        self._names = list(metrics)
        self._steps: list[tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]] = []
        self._states: list[NDArray[np.int32]] = []
        self._metrics: list[list[float]] = []
        self._number_count = 0
        self._record_step()

    @classmethod
    def from_episode(cls, episode: Any) -> Self | None:  # noqa: ANN401 - anything that can be played
        """Return a tracer if the episode reports sensors and actuators; None otherwise."""
        if not all(hasattr(episode, name) for name in ("step_observed", "machine_states", "metrics")):
            return None
        return cls(episode, getattr(episode, "metric_names", ()))

    def step(self) -> None:
        """Step the episode."""
        agents, sensors, actuators = self._episode.step_observed()
        most = MOST_NUMBERS // max(1, 200 * (sensors.shape[1] + actuators.shape[1]))
        if len(agents) and int(agents.max()) >= max(most, 1):
            few = agents < max(most, 1)
            agents, sensors, actuators = agents[few], sensors[few], actuators[few]
        numbers = sensors.size + actuators.size
        if self._number_count + numbers <= MOST_NUMBERS:
            self._number_count += numbers
            self._steps.append((agents, sensors, actuators))
        self._record_step()

    def _record_step(self) -> None:
        states = self._episode.machine_states()
        if states is not None:
            self._states.append(states)
        if self._names:
            try:
                with engine_errors():
                    self._metrics.append(list(self._episode.metrics(self._names)))
            except RunError:  # metrics are available only at the end
                self._names = []
                self._metrics.clear()

    def trace(self) -> Trace:
        """Return the record."""
        steps = self._steps
        agents = max((int(step[0].max()) + 1 for step in steps if len(step[0])), default=0)
        widths = [steps[0][part].shape[1] if steps else 0 for part in (1, 2)]
        arrays = [np.full((len(steps), agents, width), np.nan, dtype=np.float32) for width in widths]
        if steps:
            rows = np.repeat(np.arange(len(steps)), [len(step[0]) for step in steps])
            columns = np.concatenate([step[0] for step in steps])
            for part, array in enumerate(arrays, start=1):
                array[rows, columns] = np.concatenate([step[part] for step in steps])
        agent_count = max((len(states) for states in self._states), default=0)
        states = np.zeros((len(self._states), agent_count), dtype=np.int16)
        for index, recorded in enumerate(self._states):
            states[index] = np.minimum(fill_states(recorded, agent_count), MOST_STATE)
        over_time = np.array(self._metrics, dtype=np.float64).reshape(len(self._metrics), len(self._names))
        metrics = {name: over_time[:, index] for index, name in enumerate(self._names)}
        return Trace(arrays[0], arrays[1], states if self._states else None, metrics)
