"""A simulation that crashes, hangs or prints where its agent's action is within a narrow range."""

import ctypes
import logging
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright import Simulation

BROKEN = Path("broken")


class Sound(Simulation):
    title, dimensions, max_agents, sensors, actuators = "poison", 1, 1, 2, 1

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:  # noqa: ARG002
        self.steps, self.sum = 0, 0.0
        return np.array([[0.3, 0.1]], np.float32)

    def step(self, actions: Any) -> Any:
        self.steps += 1
        self.sum += float(actions[0, 0])
        if 0.30 < actions[0, 0] < 0.36:
            self.poison()
        return np.array([[0.3, 0.1]], np.float32)

    def poison(self) -> None:
        pass

    def done(self) -> bool:
        return self.steps >= 5

    def fitness(self) -> float:
        return self.sum


class Crash(Sound):
    def poison(self) -> None:
        print("about to crash")
        ctypes.string_at(0)


class Hang(Sound):
    def poison(self) -> None:
        time.sleep(1000)


class Leave(Sound):
    def poison(self) -> None:
        os._exit(7)


class Exit(Sound):
    def poison(self) -> None:
        sys.exit(3)


class Talk(Sound):
    def poison(self) -> None:
        print("printed")
        warnings.warn("warned", stacklevel=1)
        logging.getLogger("poison").warning("logged")
        os.write(1, b"written\n")


class Slow(Sound):
    def step(self, actions: Any) -> Any:
        time.sleep(0.05)
        return super().step(actions)


class Unstartable(Sound):
    """Can be started until a file appears."""

    def __init__(self) -> None:
        if BROKEN.exists():
            raise RuntimeError("the licence server does not answer")

    def poison(self) -> None:
        BROKEN.touch()
        os._exit(9)


class Tell(Sound):
    """Prints its seed, on which its fitness depends."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.seed = seed
        print("seed", seed, flush=True)
        return super().reset(parameters, seed)

    def fitness(self) -> float:
        return self.sum + self.seed % 7
