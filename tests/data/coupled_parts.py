"""A battery and a vehicle as simulations, each of which a server of its own steps."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import Simulation

Row = NDArray[np.float32]


class Battery(Simulation):
    """Gives the force that it is asked for until it is empty."""

    title = "battery"
    sensors = 2  # force, share that is left
    actuators = 1

    def reset(self, parameters: dict[str, Any], seed: int) -> Row:  # noqa: ARG002 - of the interface
        self.force, self.left, self.steps = np.float32(0), np.float32(1), 0
        return self.look()

    def step(self, actions: Row) -> Row:
        self.force = actions[0, 0] if self.left > 0 else np.float32(0)
        self.left -= np.float32(0.25) * abs(self.force)
        self.steps += 1
        return self.look()

    def look(self) -> Row:
        return np.array([[self.force, self.left]], np.float32)

    def done(self) -> bool:
        return self.steps == 100

    def fitness(self) -> float:
        return float(self.left)


class Vehicle(Simulation):
    """Is accelerated by a force."""

    title = "vehicle"
    sensors = 2  # place, speed
    actuators = 1

    def reset(self, parameters: dict[str, Any], seed: int) -> Row:  # noqa: ARG002 - of the interface
        self.place = self.speed = np.float32(0)
        self.steps = 0
        return self.look()

    def step(self, actions: Row) -> Row:
        self.speed += np.float32(0.1) * actions[0, 0]
        self.place += self.speed
        self.steps += 1
        return self.look()

    def look(self) -> Row:
        return np.array([[self.place, self.speed]], np.float32)

    def done(self) -> bool:
        return self.steps == 100

    def fitness(self) -> float:
        return float(self.place)
