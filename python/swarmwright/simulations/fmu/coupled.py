"""A system of FMUs, stepped together: as one `Instance`."""

import sys
import threading
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from swarmwright.simulations.fmu.description import Variable
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpacked
from swarmwright.simulations.fmu.ssp import Algorithm, Connection, System, extracted, variable_of

PATIENCE_S = 1.0
"""After so long it is said which component is waited for."""


class Coupled:
    """The components of an SSP, with a master that steps them with one step size.

    Jacobi: in a step every component gets the outputs that the others had at its beginning. Gauss-Seidel:
    components are stepped in the order of the file, and each gets the outputs that those before it have at
    the end of the step. J. Bastian et al., "Master for Co-Simulation Using FMI", Modelica Conference 2011.

    Args:
        file: the SSP.
        system: what is in it.
        folder: where it is unpacked.
        algorithm: jacobi or gauss_seidel.
        log: where messages go.

    Raises:
        FmuError: a component cannot be made.

    """

    def __init__(
        self, file: str, system: System, folder: Path, algorithm: Algorithm, log: TextIO = sys.stderr
    ) -> None:
        self._system, self._algorithm = system, algorithm
        self._watch = _Watch(log)
        self._instances: dict[str, Instance] = {}
        for name, source in system.sources.items():
            fmu = extracted(Path(file), source, folder / "files")
            with self._watch(name, "is being loaded"):
                place = unpacked(str(fmu), folder / name)
                self._instances[name] = Instance(system.components[name], place, name, log)
        self._into: dict[str, list[Connection]] = {
            name: [one for one in system.connections if one.end[0] == name] for name in self._instances
        }
        self._known: dict[str, tuple[Instance, Variable]] = {}

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Go to the start of an episode; `start` by `component.variable`, beside the parameter sets."""
        values = {**self._system.starts, **start}
        for name, instance in self._instances.items():
            own = {
                key.removeprefix(f"{name}."): value
                for key, value in values.items()
                if key.startswith(f"{name}.")
            }
            with self._watch(name, "is being initialized"):
                self._named(name, lambda: instance.begin(own, time, stop))  # noqa: B023 - called at once
        for name in self._instances:
            self._transfer(self._into[name])

    def set(self, variable: Variable, value: Any) -> None:  # noqa: ANN401 - a number, boolean or text
        """Set a variable `component.variable`."""
        instance, own = self._find(variable)
        instance.set(own, value)

    def get(self, variable: Variable) -> float:
        """Return a variable that is a number or boolean."""
        instance, own = self._find(variable)
        return instance.get(own)

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set variables that are numbers or booleans."""
        for variable, value in zip(variables, values, strict=True):
            self.set(variable, value)

    def numbers(self, variables: Sequence[Variable]) -> list[float]:
        """Return variables that are numbers or booleans."""
        return [self.get(one) for one in variables]

    def step(self, time: float, size: float) -> bool:
        """Go on by a step; return whether a component ends the simulation."""
        if self._algorithm == "jacobi":
            values = [self._value(one) for one in self._system.connections]
            for connection, value in zip(self._system.connections, values, strict=True):
                self._give(connection, value)
        ends = False
        for name, instance in self._instances.items():
            if self._algorithm == "gauss_seidel":
                self._transfer(self._into[name])
            with self._watch(name, f"makes its step from {time:g} s"):
                ends |= self._named(name, lambda: instance.step(time, size))  # noqa: B023 - called at once
        return ends

    def give_up(self) -> None:
        """End the episode in all components."""
        for instance in self._instances.values():
            instance.give_up()

    @property
    def waited(self) -> str:
        """How long each component was waited for, the one with the longest time first."""
        return self._watch.summary

    def end(self) -> None:
        """Free the instances."""
        for instance in self._instances.values():
            instance.end()

    def _transfer(self, connections: Sequence[Connection]) -> None:
        for one in connections:
            self._give(one, self._value(one))

    def _value(self, connection: Connection) -> float:
        name, variable = connection.start
        value = self._instances[name].get(self._system.components[name].variables[variable])
        return connection.transformation(value)

    def _give(self, connection: Connection, value: float) -> None:
        name, variable = connection.end
        instance = self._instances[name]
        self._named(name, lambda: instance.set(self._system.components[name].variables[variable], value))

    def _named(self, name: str, call: Any) -> Any:  # noqa: ANN401 - whatever the call returns
        try:
            return call()
        except FmuError as error:
            raise FmuError(f"{name}: {error}") from error

    def _find(self, variable: Variable) -> tuple[Instance, Variable]:
        if variable.name not in self._known:
            own = variable_of(self._system, variable.name)
            self._known[variable.name] = self._instances[variable.name.partition(".")[0]], replace(own)
        return self._known[variable.name]


class _Watch:
    """Says which component is waited for, when that takes long: the process may be ended meanwhile."""

    def __init__(self, log: TextIO) -> None:
        self._log = log
        self._current: tuple[str, float] | None = None
        self._waited: dict[str, list[float]] = {}
        """By component: seconds in all, calls, the longest one."""
        self._told: tuple[str, float] | None = None
        threading.Thread(target=self._look, daemon=True).start()

    def __call__(self, name: str, what: str) -> "_Watch":
        self._name, self._next = name, f"{name}, which {what}"
        return self

    def __enter__(self) -> None:
        self._current = (self._next, clock.monotonic())

    def __exit__(self, *_: object) -> None:
        if self._current is not None:
            seconds = clock.monotonic() - self._current[1]
            total = self._waited.setdefault(self._name, [0.0, 0, 0.0])
            self._waited[self._name] = [total[0] + seconds, total[1] + 1, max(total[2], seconds)]
        self._current = None

    @property
    def summary(self) -> str:
        """Seconds by component, the one that was waited for longest first."""
        found = sorted(self._waited.items(), key=lambda one: -one[1][0])
        return ", ".join(
            f"{name} {total:.3g} s in {calls:,.0f} calls (longest {most:.3g} s)"
            for name, (total, calls, most) in found
        )

    def _look(self) -> None:
        while True:
            clock.sleep(PATIENCE_S / 4)
            current = self._current
            if current is None or current is self._told or clock.monotonic() - current[1] < PATIENCE_S:
                continue
            self._told = current
            print(f"waiting for the component {current[0]}", file=self._log, flush=True)
