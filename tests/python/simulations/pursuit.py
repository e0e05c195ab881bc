"""Hunters and prey in one dimension: two kinds of agents with other sensors, actuators and numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import Group, Parameter, Simulation


class Pursuit(Simulation):
    """Hunters sense the prey and choose a direction; prey senses two hunters, chooses direction and speed."""

    title, dimensions = "pursuit", 1
    groups: Mapping[str, Group] = {
        "hunters": Group(agents="hunters", sensors=1, actuators=1, sensor_names=["prey"]),
        "prey": Group(agents=1, sensors=3, actuators=2),
    }
    parameters: Mapping[str, Any] = {"hunters": Parameter(2, minimum=1, maximum=50)}
    metrics = ("distance",)

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.x = np.random.default_rng(seed).uniform(-1, 1, parameters["hunters"] + 1)
        self.steps, self.sum = 0, 0.0
        return self.look()

    def step(self, actions: NDArray[np.float32]) -> Any:
        assert not actions[:-1, 1:].any(), "hunters have one actuator"
        self.x[:-1] += 0.1 * actions[:-1, 0]
        self.x[-1] += 0.1 * actions[-1, 0] * (actions[-1, 1] + 1)
        self.x = np.clip(self.x, -2, 2)
        self.steps += 1
        self.sum += float(np.abs(self.x[:-1] - self.x[-1]).min())
        return self.look()

    def look(self) -> Any:
        away = np.sort(self.x[:-1] - self.x[-1])
        return [*([x - self.x[-1]] for x in self.x[:-1]), [away[0], away[-1], self.x[-1]]]

    def done(self) -> bool:
        return self.steps == 12

    def fitness(self) -> float:
        return -self.sum

    def measure(self) -> dict[str, float]:
        return {"distance": self.sum}
