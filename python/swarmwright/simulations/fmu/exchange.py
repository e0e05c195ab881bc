"""Instances of an FMU for model exchange: a solver of FMPy's integrates their equations."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model
from fmpy.simulation import ForwardEuler
from fmpy.sundials import CVodeSolver

from swarmwright.simulations.fmu.description import Description, Variable
from swarmwright.simulations.fmu.instances import FmuError, Instance

_TOLERANCE = 1e-5
"""Relative, where the FMU proposes none: FMPy's."""
_LONGEST_STEP = 50
"""Steps of CVode in an episode, at least: as in FMPy."""


class _NoInput:
    """What FMPy's solvers ask for inputs, which are constant during a step here."""

    def apply(self, *_: object) -> None:
        """Change nothing."""


class ExchangeInstance(Instance):
    """One instance, integrated as `fmpy.simulate_fmu` does.

    A state or time event, and a change of the inputs, begins the integration anew.

    Args:
        description: of the FMU.
        folder: where it is unpacked.
        name: of the instance.
        solver: CVode, of variable order and steps; Euler, with one step of Euler's method in each step.

    Raises FmuError as Instance does.
    """

    def __init__(self, description: Description, folder: Path, name: str, solver: str) -> None:
        assert description.exchange is not None
        self._known = description.exchange
        self._kind_of_solver = solver
        super().__init__(description, folder, name)

    def _library(self, arguments: dict[str, str]) -> Any:  # noqa: ANN401 - FMPy has no types
        arguments["modelIdentifier"] = self._known.identifier
        return FMU2Model(**arguments) if self._two else FMU3Model(**arguments)

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Go to the start of an episode, with these values of variables."""
        super().begin(start, time, stop)
        self._begin, self._now, self._made = time, time, 0
        self._ended = False
        self._given: dict[tuple[str, ...], list[float]] = {}
        """By the names of variables: each agent in this instance sets its own."""
        self._failed: FMICallException | None = None
        self._next_event: float | None = None
        self._update()
        self._called("initialization", self._fmu.enterContinuousTimeMode)
        self._solver = self._called("the solver", self._solver_for, stop)
        self._check()

    def _solver_for(self, stop: float) -> Any:  # noqa: ANN401 - FMPy has no types
        fmu = self._fmu
        arguments = {
            "nx": self._known.states,
            "nz": self._known.indicators,
            "get_x": self._kept(fmu.getContinuousStates),
            "set_x": self._kept(fmu.setContinuousStates),
            "get_dx": self._kept(fmu.getDerivatives if self._two else fmu.getContinuousStateDerivatives),
            "get_z": self._kept(fmu.getEventIndicators),
            "input": _NoInput(),
        }
        if self._kind_of_solver == "Euler":
            return ForwardEuler(**arguments)
        return CVodeSolver(
            get_nominals=self._kept(fmu.getNominalsOfContinuousStates),
            set_time=self._kept(fmu.setTime),
            startTime=self._begin,
            maxStep=(stop - self._begin) / _LONGEST_STEP,
            relativeTolerance=self._description.tolerance or _TOLERANCE,
            **arguments,
        )

    def _kept(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function whose error is kept: CVode calls it, and passes none on."""

        def called(*arguments: object) -> None:
            try:
                function(*arguments)
            except FMICallException as error:
                self._failed = self._failed or error

        return called

    def _check(self) -> None:
        if self._failed is not None:
            raise FmuError(self._explained(f"the integration from {self._now:g} s", self._failed))

    def _update(self) -> None:
        """Let discrete states change, until they change no more; note the next time event."""
        again = True
        while again and not self._ended:
            function = self._fmu.newDiscreteStates if self._two else self._fmu.updateDiscreteStates
            again, self._ended, _, _, is_defined, at = self._called(f"the event at {self._now:g} s", function)
            self._next_event = float(at) if is_defined else None

    def _event(self, change: Callable[[], None] | None = None) -> None:
        self._called(f"the event at {self._now:g} s", self._fmu.enterEventMode)
        if change is not None:
            change()
        self._update()
        if not self._ended:
            self._called(f"the event at {self._now:g} s", self._fmu.enterContinuousTimeMode)
            self._solver.reset(self._now)
            self._check()

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set the inputs; others than before are an event."""
        names, given = tuple(one.name for one in variables), list(values)
        if given != self._given.get(names) and not self._ended:
            self._given[names] = given
            self._event(lambda: super(ExchangeInstance, self).put(variables, values))

    def step(self, time: float, size: float) -> bool:
        """Integrate to the end of a step; return whether the FMU ends the simulation."""
        self._last = ""
        self._made += 1
        # As FMPy adds, so that both have the same bits.
        end = self._begin + self._made * size
        while not self._ended and self._now < end and not math.isclose(self._now, end):
            event = self._next_event
            is_first = event is not None and event < end and not math.isclose(event, end)
            target = event if event is not None and is_first else end
            is_event, reached = self._integrate(target)
            self._called("the time", self._fmu.setTime, reached)
            self._now = reached
            is_event |= event is not None and math.isclose(reached, event)
            if self._known.completes:
                what = f"the step from {time:g} s"
                asked, self._ended = self._called(what, self._fmu.completedIntegratorStep)
                is_event |= bool(asked)
            if is_event and not self._ended:
                self._event()
        return self._ended

    def _integrate(self, target: float) -> tuple[bool, float]:
        """Integrate to a time, or to an event before; return whether there was one, and the time."""
        try:
            is_event, _, reached = self._solver.step(self._now, target)
        except Exception as error:  # CVode's failures
            self._check()
            raise FmuError(f"the solver failed after {self._now:g} s: {error}") from error
        self._check()
        return bool(is_event), float(reached)
