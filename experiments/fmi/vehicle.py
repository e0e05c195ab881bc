"""A vehicle with mass that is to reach a goal, as an FMU: pythonfmu build -f vehicle.py."""

import math
import random

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

PARAMETER = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}


class Vehicle(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=6.0, step_size=0.1)
        self.mass, self.seed = 1.0, 0
        self.steer = self.thrust = self.goal_x = self.goal_y = self.distance = 0.0
        self.register_variable(Real("mass", **PARAMETER))
        self.register_variable(Integer("seed", **PARAMETER))
        for name in ("steer", "thrust"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("goal_x", "goal_y", "distance"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.x, self.y, self.speed = 0.0, 0.0, 0.0
        self.heading = random.Random(self.seed).uniform(-3, 3)
        self.sense()

    def do_step(self, time, size):
        self.heading += 2.0 * self.steer * size
        self.speed += (self.thrust - 0.5 * self.speed) / self.mass * size
        self.x += self.speed * math.cos(self.heading) * size
        self.y += self.speed * math.sin(self.heading) * size
        self.sense()
        return True

    def sense(self):
        dx, dy = 3.0 - self.x, 2.0 - self.y
        c, s = math.cos(self.heading), math.sin(self.heading)
        self.goal_x, self.goal_y = 0.2 * (c * dx + s * dy), 0.2 * (c * dy - s * dx)
        self.distance = math.hypot(dx, dy)
