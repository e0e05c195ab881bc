"""Two robots in one FMU: pythonfmu builds it for the tests."""

from typing import Any

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Real


class Pair(Fmi2Slave):  # type: ignore[misc] # pythonfmu has no types
    """Robots on a line."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=1.0, step_size=0.1)
        self.gap = 0.0
        for number in (1, 2):
            setattr(self, f"x{number}", 0.0)
            setattr(self, f"v{number}", 0.0)
            self.register_variable(Real(f"x{number}", causality=Fmi2Causality.output))
            self.register_variable(Real(f"v{number}", causality=Fmi2Causality.input))
        self.register_variable(Real("gap", causality=Fmi2Causality.output))

    def exit_initialization_mode(self) -> None:
        self.x1, self.x2 = -1.0, 1.0
        self.gap = 2.0

    def do_step(self, now: float, size: float) -> bool:  # noqa: ARG002 - pythonfmu calls it
        self.x1 += self.v1 * size
        self.x2 += self.v2 * size
        self.gap = self.x2 - self.x1
        return True
