"""Vehicles that are to reach a goal, as FMUs: pythonfmu builds them for the tests."""

import math
import os
import random
import signal
import time
from typing import Any

from pythonfmu import (
    Boolean,
    DefaultExperiment,
    Fmi2Causality,
    Fmi2Slave,
    Fmi2Variability,
    Integer,
    Real,
    String,
)

DISCRETE = {"variability": Fmi2Variability.discrete}
PARAMETER = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}


class Vehicle(Fmi2Slave):  # type: ignore[misc] # pythonfmu has no types
    """A vehicle with mass; what can go wrong is a parameter."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=2.0, step_size=0.1)
        self.mass, self.seed, self.trouble = 1.0, 0, ""
        self.steer = self.thrust = 0.0
        self.goal_x = self.goal_y = self.distance = 0.0
        self.fast, self.process, self.kept = False, 0, 0
        self.register_variable(Real("mass", **PARAMETER))
        self.register_variable(Integer("seed", **PARAMETER))
        self.register_variable(String("trouble", **PARAMETER))
        for name in ("steer", "thrust"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("goal_x", "goal_y", "distance"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.register_variable(Boolean("fast", causality=Fmi2Causality.output, **DISCRETE))
        self.register_variable(Integer("process", causality=Fmi2Causality.local, **DISCRETE))

    def exit_initialization_mode(self) -> None:
        draw = random.Random(self.seed)
        self.x, self.y, self.heading, self.speed = 0.0, 0.0, draw.uniform(-3, 3), 0.0
        self.process = os.getpid()
        self.sense()

    def sense(self) -> None:
        dx, dy = 3.0 - self.x, 2.0 - self.y
        c, s = math.cos(self.heading), math.sin(self.heading)
        self.goal_x, self.goal_y = 0.2 * (c * dx + s * dy), 0.2 * (c * dy - s * dx)
        self.distance = math.hypot(dx, dy)
        self.fast = self.speed > 0.5

    def do_step(self, now: float, size: float) -> bool:
        if now > 0.45 and self.trouble:
            self.fail()
        self.heading += 2.0 * self.steer * size
        self.speed += (self.thrust - 0.5 * self.speed) / self.mass * size
        self.x += self.speed * math.cos(self.heading) * size
        self.y += self.speed * math.sin(self.heading) * size
        self.sense()
        if self.trouble == "nan":
            self.goal_x = math.nan
        return self.trouble != "refuse"

    def fail(self) -> None:
        if self.trouble == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        elif self.trouble == "hang":
            time.sleep(1000)
        elif self.trouble == "print":
            for _ in range(1000):
                os.write(1, b"{ this is no answer }\n" * 100)
        elif self.trouble == "raise":
            raise RuntimeError("the motor is broken")
