"""A variable of each type of FMI 2.0: pythonfmu builds it for the tests."""

from typing import Any

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

INPUT = {"causality": Fmi2Causality.input, "variability": Fmi2Variability.discrete}
PARAMETER = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}


class Switches(Fmi2Slave):  # type: ignore[misc] # pythonfmu has no types
    """Its output is what its parameters are."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.gain, self.count, self.on, self.label = 1.0, 3, True, "x"
        self.gate, self.mode, self.total = False, 0, 0.0
        self.register_variable(Real("gain", **PARAMETER))
        self.register_variable(Integer("count", **PARAMETER))
        self.register_variable(Boolean("on", **PARAMETER))
        self.register_variable(String("label", **PARAMETER))
        self.register_variable(Boolean("gate", **INPUT))
        self.register_variable(Integer("mode", **INPUT))
        self.register_variable(Real("total", causality=Fmi2Causality.output))

    def do_step(self, _now: float, _size: float) -> bool:
        self.total += (self.gain + self.count) * (10.0 if self.on else 1.0)
        return True
