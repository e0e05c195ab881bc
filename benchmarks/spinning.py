"""An evaluation that keeps a processor busy for 0.1 ms, in pure Python."""

import time
from typing import Any

import swarmwright

SECONDS = 1e-4


def spin() -> None:
    """Keep a processor busy; time in which the thread has none does not count."""
    end = time.thread_time() + SECONDS
    while time.thread_time() < end:
        pass


class Spinning(swarmwright.Simulation):
    """One step, which spins."""

    title, dimensions, sensors, actuators, parameters = "spinning", 1, 1, 1, {}

    def reset(self, parameters: dict[str, Any], seed: int) -> list[list[float]]:  # noqa: ARG002 - the interface's
        """Begin."""
        self.spins = 0.0
        return [[0.0]]

    def step(self, actuators: Any) -> list[list[float]]:  # noqa: ARG002 - the interface's
        """Spin."""
        spin()
        self.spins += 1
        return [[0.0]]

    def done(self) -> bool:
        """After one step."""
        return self.spins > 0

    def fitness(self) -> float:
        """How often it has spun."""
        return self.spins
