"""A battery that drives a motor until it is empty: thrust in, force out."""

from typing import Any

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

PARAMETER = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}


class Battery(Fmi2Slave):  # type: ignore[misc] # pythonfmu has no types
    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=2.0, step_size=0.1)
        self.capacity, self.thrust, self.force, self.used = 1.0, 0.0, 0.0, 0.0
        self.register_variable(Real("capacity", **PARAMETER))
        self.register_variable(Real("thrust", causality=Fmi2Causality.input))
        for name in ("force", "used"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self) -> None:
        self.force, self.used = 0.0, 0.0

    def do_step(self, _now: float, size: float) -> bool:
        self.force = 0.001 * self.thrust if self.used < self.capacity else 0.0
        self.used += abs(self.thrust) * size
        return True
