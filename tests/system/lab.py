"""A simulation whose servers are good, slow, broken or wrong, as FAULT in the environment says."""

import os
import signal
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import Simulation

PACE = 0.005
"""Seconds of a step."""


class Lab(Simulation):
    """One agent on a line, eight steps."""

    title = "lab"
    dimensions = 1
    sensors = 2
    actuators = 1
    determinism = "bitwise"

    def __init__(self) -> None:
        self.kind, _, self.value = os.environ.get("FAULT", "none").partition("=")

    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:  # noqa: ARG002
        self.place, self.left = (seed % 7) / 7, 8
        return self.seen()

    def seen(self) -> NDArray[np.float64]:
        rows = np.array([[self.place, self.left / 8]])
        if self.left == 5 and self.kind == "nan":
            rows[0, 0] = np.nan
        return rows[:, :1] if self.left == 5 and self.kind == "short" else rows

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        time.sleep(PACE * (10 if self.kind == "slow" else 1))
        self.place += float(actions[0, 0])
        self.left -= 1
        return self.seen()

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        if self.kind == "poison" and self.place == float(self.value):
            os.kill(os.getpid(), signal.SIGKILL)
        match self.kind:
            case "constant":
                return 0.25
            case "off":
                return self.place * 1.01
        return self.place
