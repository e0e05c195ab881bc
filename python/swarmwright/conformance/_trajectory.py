"""The trajectory of an episode, and policies of agents."""

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine

Numbers = NDArray[np.float32]


Policy = Callable[[int, int, Numbers], Sequence[float]]
"""Function of agent, number of its earlier messages in the episode, and sensors; returns actuators."""


@dataclass(frozen=True)
class Wander:
    """Actuators that vary only with agent and turn: multiples of 1/64 in -1..+1.

    seed: selects one of many sequences.
    """

    actuators: int
    seed: int = 0

    def __call__(self, agent: int, turn: int, _sensors: Numbers) -> list[float]:
        """Return the actuators of an agent."""
        rows = []
        for index in range(self.actuators):
            number = (self.seed * 40503 + agent * 69069 + turn * 30011 + index * 7919 + 12345) & 0xFFFFFFFF
            number = (number ^ (number >> 15)) * 0x2C1B3C6D & 0xFFFFFFFF
            number ^= number >> 12
            rows.append(((number % 129) - 64) / 64)
        return rows


@dataclass(frozen=True)
class Always:
    """Constant actuators."""

    values: tuple[float, ...]

    def __call__(self, _agent: int, _turn: int, _sensors: Numbers) -> Sequence[float]:
        """Return the actuators of an agent."""
        return self.values


class Steer:
    """A controller for each agent, computed with Swarmwright's arithmetic.

    specification: with weights, see protocol/schemas/controller.schema.json.
    """

    def __init__(self, specification: Mapping[str, Any]) -> None:
        self._text = json.dumps(specification)
        self._agents: dict[int, _engine.Controller] = {}

    def __call__(self, agent: int, turn: int, sensors: Numbers) -> Sequence[float]:
        """Return the actuators of an agent."""
        if turn == 0 or agent not in self._agents:
            self._agents[agent] = _engine.Controller(self._text)
        # Send the shortest decimals that read back as these numbers.
        return [float(str(value)) for value in self._agents[agent].step(sensors)]


@dataclass
class Trajectory:
    """The sensors of each agent in order, and the end of the episode.

    fitness: None if the episode was not played to its end. messages: sensor messages. seconds: from control
    to fitness. sensors_only: fitness and metrics are not compared with those of other trajectories.
    """

    readings: dict[int, list[Numbers]] = field(default_factory=lambda: defaultdict(list))
    fitness: float | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    messages: int = 0
    seconds: float = 0.0
    sensors_only: bool = False

    def difference(self, other: "Trajectory") -> str:
        """Describe the first difference from another trajectory; empty if all bits are the same."""
        sensed = self.find_sensor_difference(other)
        if sensed or self.sensors_only or other.sensors_only:
            return sensed
        return self._result_difference(other)

    def find_sensor_difference(self, other: "Trajectory") -> str:
        """Describe the first difference in sensors; empty if all bits are the same."""
        for agent in sorted({*self.readings, *other.readings}):
            mine, theirs = self.readings.get(agent, []), other.readings.get(agent, [])
            for turn, (first, second) in enumerate(zip(mine, theirs, strict=False)):
                if first.tobytes() != second.tobytes():
                    values = f"{format_numbers(first)} and {format_numbers(second)}"
                    return f"agent {agent} senses {values} in its message {turn}"
            if len(mine) != len(theirs):
                return f"agent {agent} gets {len(mine)} and {len(theirs)} sensor messages"
        return ""

    def _result_difference(self, other: "Trajectory") -> str:
        if not is_same_fitness(self.fitness, other.fitness):
            return f"the fitness is {self.fitness!r} and {other.fitness!r}"
        for name in sorted({*self.metrics, *other.metrics}):
            if not is_same_fitness(self.metrics.get(name), other.metrics.get(name)):
                return f"metric {name} is {self.metrics.get(name)!r} and {other.metrics.get(name)!r}"
        return ""


def is_same_fitness(first: float | None, other: float | None) -> bool:
    """Return whether two values have the same bits, or both are None."""
    if first is None or other is None:
        return first is other
    return np.float64(first).tobytes() == np.float64(other).tobytes()


def format_numbers(numbers: Numbers) -> str:
    """Format numbers as text."""
    texts = [str(value) for value in numbers[:6]]
    return f"[{', '.join(texts)}{', ...' if len(numbers) > 6 else ''}]"
