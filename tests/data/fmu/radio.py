"""A radio that brings a number a step late."""

from typing import Any

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Radio(Fmi2Slave):  # type: ignore[misc] # pythonfmu has no types
    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.sent = self.late = self.received = 0.0
        self.register_variable(Real("sent", causality=Fmi2Causality.input))
        self.register_variable(Real("received", causality=Fmi2Causality.output))

    def exit_initialization_mode(self) -> None:
        self.received = self.late = 0.0

    def do_step(self, _now: float, _size: float) -> bool:
        self.received, self.late = self.late, self.sent
        return True
