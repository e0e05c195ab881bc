"""What agents sense and do in an episode, the states of their controllers, and metrics over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import RunError, engine_errors

MOST_NUMBERS = 30_000_000
"""Sensors and actuators that are kept of an episode: 120 MB. With more agents, those of the first ones."""


MOST_STATE = 254
"""Largest number of a state that is kept; it also stands for those after it."""


def states_of(known: NDArray[np.signedinteger[Any]], agents: int) -> NDArray[np.int32]:
    """Return the states of so many agents: those that are known, and of agents that have not acted yet."""
    states = np.zeros(max(agents, len(known)), dtype=np.int32)
    states[len(known) :] = -1 if len(known) and known[-1] < 0 else 0
    states[: len(known)] = known
    return states


@dataclass(frozen=True)
class Trace:
    """What is known of each agent at each step; S steps, A agents that are kept, the first ones.

    sensors: (S, A, sensors), what they sensed before a step; NaN for those that did not act. actuators:
    (S, A, actuators), what they did in it. states: (S + 1, all agents), the state in which the state machine
    of each makes its next step, 254 at most; -1 for agents whose controller has no states; None where none
    has any. metrics: names -> (S + 1,), NaN where they are not known.
    """

    sensors: NDArray[np.float32]
    actuators: NDArray[np.float32]
    states: NDArray[np.int16] | None
    metrics: dict[str, NDArray[np.float64]]


class Tracer:
    """Steps an episode and keeps what agents sense and do."""

    def __init__(self, episode: Any, metrics: Sequence[str]) -> None:  # noqa: ANN401 - see `of`
        self._episode = episode
        self._names = list(metrics)
        self._steps: list[tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]] = []
        self._states: list[NDArray[np.int32]] = []
        self._metrics: list[list[float]] = []
        self._kept = 0
        self._note()

    @classmethod
    def of(cls, episode: Any) -> Self | None:  # noqa: ANN401 - anything that can be played
        """Return one for an episode that says what agents do; None for another one."""
        if not all(hasattr(episode, name) for name in ("step_observed", "machine_states", "metrics")):
            return None
        return cls(episode, getattr(episode, "metric_names", ()))

    def step(self) -> None:
        """Step the episode."""
        agents, sensors, actuators = self._episode.step_observed()
        most = MOST_NUMBERS // max(1, 200 * (sensors.shape[1] + actuators.shape[1]))
        few = agents < max(most, 1)
        numbers = sum(part.size for part in (sensors[few], actuators[few]))
        if self._kept + numbers <= MOST_NUMBERS:
            self._kept += numbers
            self._steps.append((agents[few], sensors[few], actuators[few]))
        self._note()

    def _note(self) -> None:
        states = self._episode.machine_states()
        if states is not None:
            self._states.append(states)
        if self._names:
            try:
                with engine_errors():
                    self._metrics.append(list(self._episode.metrics(self._names)))
            except RunError:  # known at the end only
                self._names = []
                self._metrics.clear()

    def trace(self) -> Trace:
        """Return what was kept."""
        steps = self._steps
        agents = max((int(step[0].max()) + 1 for step in steps if len(step[0])), default=0)
        widths = [steps[0][part].shape[1] if steps else 0 for part in (1, 2)]
        kept = [np.full((len(steps), agents, width), np.nan, dtype=np.float32) for width in widths]
        for index, (who, *numbers) in enumerate(steps):
            for into, values in zip(kept, numbers, strict=True):
                into[index, who] = values
        everyone = max((len(states) for states in self._states), default=0)
        states = np.zeros((len(self._states), everyone), dtype=np.int16)
        for index, now in enumerate(self._states):
            states[index] = np.minimum(states_of(now, everyone), MOST_STATE)
        over_time = np.array(self._metrics, dtype=np.float64).reshape(len(self._metrics), len(self._names))
        metrics = {name: over_time[:, index] for index, name in enumerate(self._names)}
        return Trace(kept[0], kept[1], states if self._states else None, metrics)
