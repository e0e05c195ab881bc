"""A battery that limits the thrust of a vehicle, as an FMU: pythonfmu build -f battery.py."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

PARAMETER = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}


class Battery(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.capacity, self.thrust, self.force, self.used = 2.0, 0.0, 0.0, 0.0
        self.register_variable(Real("capacity", **PARAMETER))
        self.register_variable(Real("thrust", causality=Fmi2Causality.input))
        for name in ("force", "used"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.force, self.used = 0.0, 0.0

    def do_step(self, time, size):
        self.force = self.thrust if self.used < self.capacity else 0.0
        self.used += abs(self.force) * size
        return True
