"""Runs episodes of an FMU, with JSON lines over standard input and output, see `command/stepwise.py`."""

import json
import math
import os
import sys
import threading
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model
from fmpy.simulation import ForwardEuler
from fmpy.sundials import CVodeSolver

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import (
    AGENT,
    Description,
    Variable,
    convert_actuator,
    reduce_seed,
)
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpack
from swarmwright.simulations.fmu.ssp import (
    VERSION,
    Algorithm,
    Connection,
    System,
    describe,
    extract,
    find_variable,
    read_system,
)
from swarmwright.simulations.ros.expression import FUNCTIONS, Expression, mean

PATIENCE_S = 1.0
"""Seconds of waiting for a component after which a message is printed."""


class Coupled:
    """The components of an SSP, stepped together with the same step size.

    Jacobi: each component receives the outputs of the others at the beginning of the step. Gauss-Seidel:
    components are stepped in the order of the file, and each receives the outputs of the previous ones at the
    end of the step. J. Bastian et al., "Master for Co-Simulation Using FMI", Modelica Conference 2011.

    Args:
        file: the SSP.
        system: the system in it.
        folder: folder for unpacked files.
        algorithm: jacobi or gauss_seidel.
        log: stream for messages.

    Raises:
        FmuError: a component cannot be created.
    """

    def __init__(
        self, file: str, system: System, folder: Path, algorithm: Algorithm, log: TextIO = sys.stderr
    ) -> None:
        self._system, self._algorithm = system, algorithm
        self._watch = _Watch(log)
        self._instances: dict[str, Instance] = {}
        for name, source in system.sources.items():
            fmu = extract(Path(file), source, folder / "files")
            with self._watch(name, "is being loaded"):
                unpacked_folder = unpack(str(fmu), folder / name)
                self._instances[name] = Instance(system.components[name], unpacked_folder, name, log)
        self._into: dict[str, list[Connection]] = {
            name: [connection for connection in system.connections if connection.end[0] == name]
            for name in self._instances
        }
        self._variables_by_name: dict[str, tuple[Instance, Variable]] = {}

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Start an episode; start: values by `component.variable`, in addition to the parameter sets."""
        values = {**self._system.starts, **start}
        for name, instance in self._instances.items():
            component_values = {
                key.removeprefix(f"{name}."): value
                for key, value in values.items()
                if key.startswith(f"{name}.")
            }
            with self._watch(name, "is being initialized"):
                self._prefix_errors(name, lambda: instance.begin(component_values, time, stop))  # noqa: B023 - called at once
        for name in self._instances:
            self._transfer(self._into[name])

    def set(self, variable: Variable, value: Any) -> None:  # noqa: ANN401 - a number, boolean or text
        """Set a variable `component.variable`."""
        instance, component_variable = self._find(variable)
        instance.set(component_variable, value)

    def get(self, variable: Variable) -> float:
        """Return a variable that is a number or boolean."""
        instance, component_variable = self._find(variable)
        return instance.get(component_variable)

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set variables that are numbers or booleans."""
        for variable, value in zip(variables, values, strict=True):
            self.set(variable, value)

    def numbers(self, variables: Sequence[Variable]) -> list[float]:
        """Return variables that are numbers or booleans."""
        return [self.get(variable) for variable in variables]

    def step(self, time: float, size: float) -> bool:
        """Advance by one step; return whether a component ends the simulation."""
        if self._algorithm == "jacobi":
            values = [self._value(end) for end in self._system.connections]
            for connection, value in zip(self._system.connections, values, strict=True):
                self._give(connection, value)
        ends = False
        for name, instance in self._instances.items():
            if self._algorithm == "gauss_seidel":
                self._transfer(self._into[name])
            with self._watch(name, f"makes its step from {time:g} s"):
                ends |= self._prefix_errors(name, lambda: instance.step(time, size))  # noqa: B023 - called at once
        return ends

    def give_up(self) -> None:
        """End the episode in all components."""
        for instance in self._instances.values():
            instance.give_up()

    @property
    def waiting_times(self) -> str:
        """Waiting times of the components, the longest first."""
        return self._watch.summary

    def end(self) -> None:
        """Free the instances."""
        for instance in self._instances.values():
            instance.end()

    def _transfer(self, connections: Sequence[Connection]) -> None:
        for connection in connections:
            self._give(connection, self._value(connection))

    def _value(self, connection: Connection) -> float:
        name, variable = connection.start
        value = self._instances[name].get(self._system.components[name].variables[variable])
        return connection.transformation(value)

    def _give(self, connection: Connection, value: float) -> None:
        name, variable = connection.end
        instance = self._instances[name]
        self._prefix_errors(
            name, lambda: instance.set(self._system.components[name].variables[variable], value)
        )

    def _prefix_errors(self, name: str, call: Any) -> Any:  # noqa: ANN401 - whatever the call returns
        try:
            return call()
        except FmuError as error:
            raise FmuError(f"{name}: {error}") from error

    def _find(self, variable: Variable) -> tuple[Instance, Variable]:
        if variable.name not in self._variables_by_name:
            component_variable = find_variable(self._system, variable.name)
            self._variables_by_name[variable.name] = (
                self._instances[variable.name.partition(".")[0]],
                replace(component_variable),
            )
        return self._variables_by_name[variable.name]


class _Watch:
    """Prints which component is waited for if that takes long, as the process may be killed meanwhile."""

    def __init__(self, log: TextIO) -> None:
        self._log = log
        self._current: tuple[str, float] | None = None
        self._waiting_times: dict[str, list[float]] = {}
        """Component -> total seconds, number of calls, seconds of the longest call."""
        self._reported: tuple[str, float] | None = None
        threading.Thread(target=self._look, daemon=True).start()

    def __call__(self, name: str, action: str) -> "_Watch":
        self._name, self._next = name, f"{name}, which {action}"
        return self

    def __enter__(self) -> None:
        self._current = (self._next, clock.monotonic())

    def __exit__(self, *_: object) -> None:
        if self._current is not None:
            seconds = clock.monotonic() - self._current[1]
            total = self._waiting_times.setdefault(self._name, [0.0, 0, 0.0])
            self._waiting_times[self._name] = [total[0] + seconds, total[1] + 1, max(total[2], seconds)]
        self._current = None

    @property
    def summary(self) -> str:
        """Waiting times of the components, the longest first."""
        times = sorted(self._waiting_times.items(), key=lambda item: -item[1][0])
        return ", ".join(
            f"{name} {total:.3g} s in {calls:,.0f} calls (longest {most:.3g} s)"
            for name, (total, calls, most) in times
        )

    def _look(self) -> None:
        while True:
            clock.sleep(PATIENCE_S / 4)
            current = self._current
            if current is None or current is self._reported or clock.monotonic() - current[1] < PATIENCE_S:
                continue
            self._reported = current
            print(f"waiting for the component {current[0]}", file=self._log, flush=True)


_TOLERANCE = 1e-5
"""Relative tolerance if the FMU recommends none, FMPy's default."""
_LONGEST_STEP = 50
"""Fewest steps of CVode in an episode, FMPy's default."""


class _NoInput:
    """Inputs for FMPy's solvers; inputs are constant during a step."""

    def apply(self, *_: object) -> None:
        """Change nothing."""


class ExchangeInstance(Instance):
    """An instance for model exchange, integrated like in `fmpy.simulate_fmu`.

    State events, time events and changes of the inputs restart the integration.

    Args:
        description: description of the FMU.
        folder: folder of the unpacked FMU.
        name: name of the instance.
        solver: CVode, with variable order and steps; or Euler, with the steps of the simulation.

    Raises FmuError like `Instance`.
    """

    def __init__(self, description: Description, folder: Path, name: str, solver: str) -> None:
        assert description.exchange is not None
        self._exchange = description.exchange
        self._kind_of_solver = solver
        super().__init__(description, folder, name)

    def _library(self, arguments: dict[str, str]) -> Any:  # noqa: ANN401 - FMPy has no types
        arguments["modelIdentifier"] = self._exchange.identifier
        return FMU2Model(**arguments) if self._two else FMU3Model(**arguments)

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Start an episode, with these values of variables."""
        super().begin(start, time, stop)
        self._begin, self._now, self._steps_made = time, time, 0
        self._ended = False
        self._inputs: dict[tuple[str, ...], list[float]] = {}
        """Names of variables -> their values; each agent in this instance sets its own."""
        self._failed: FMICallException | None = None
        self._next_event: float | None = None
        self._update()
        self._call("initialization", self._fmu.enterContinuousTimeMode)
        self._solver = self._call("the solver", self._solver_for, stop)
        self._check()

    def _solver_for(self, stop: float) -> Any:  # noqa: ANN401 - FMPy has no types
        fmu = self._fmu
        arguments = {
            "nx": self._exchange.states,
            "nz": self._exchange.indicators,
            "get_x": self._catch_errors(fmu.getContinuousStates),
            "set_x": self._catch_errors(fmu.setContinuousStates),
            "get_dx": self._catch_errors(
                fmu.getDerivatives if self._two else fmu.getContinuousStateDerivatives
            ),
            "get_z": self._catch_errors(fmu.getEventIndicators),
            "input": _NoInput(),
        }
        if self._kind_of_solver == "Euler":
            return ForwardEuler(**arguments)
        return CVodeSolver(
            get_nominals=self._catch_errors(fmu.getNominalsOfContinuousStates),
            set_time=self._catch_errors(fmu.setTime),
            startTime=self._begin,
            maxStep=(stop - self._begin) / _LONGEST_STEP,
            relativeTolerance=self._description.tolerance or _TOLERANCE,
            **arguments,
        )

    def _catch_errors(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that stores errors, because CVode, which calls it, ignores them."""

        def call(*arguments: object) -> None:
            try:
                function(*arguments)
            except FMICallException as error:
                self._failed = self._failed or error

        return call

    def _check(self) -> None:
        if self._failed is not None:
            raise FmuError(self._describe_error(f"the integration from {self._now:g} s", self._failed))

    def _update(self) -> None:
        """Update discrete states until they are stable; store the time of the next time event."""
        needs_update = True
        while needs_update and not self._ended:
            function = self._fmu.newDiscreteStates if self._two else self._fmu.updateDiscreteStates
            needs_update, self._ended, _, _, is_defined, at = self._call(
                f"the event at {self._now:g} s", function
            )
            self._next_event = float(at) if is_defined else None

    def _event(self, change: Callable[[], None] | None = None) -> None:
        self._call(f"the event at {self._now:g} s", self._fmu.enterEventMode)
        if change is not None:
            change()
        self._update()
        if not self._ended:
            self._call(f"the event at {self._now:g} s", self._fmu.enterContinuousTimeMode)
            self._solver.reset(self._now)
            self._check()

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set the inputs; changed inputs trigger an event."""
        names, inputs = tuple(variable.name for variable in variables), list(values)
        if inputs != self._inputs.get(names) and not self._ended:
            self._inputs[names] = inputs
            self._event(lambda: super(ExchangeInstance, self).put(variables, values))

    def step(self, time: float, size: float) -> bool:
        """Integrate to the end of a step; return whether the FMU ends the simulation."""
        self._last = ""
        self._steps_made += 1
        # The same sum as in FMPy, so that results are bit-identical.
        end = self._begin + self._steps_made * size
        while not self._ended and self._now < end and not math.isclose(self._now, end):
            event = self._next_event
            is_first = event is not None and event < end and not math.isclose(event, end)
            target = event if event is not None and is_first else end
            is_event, reached = self._integrate(target)
            self._call("the time", self._fmu.setTime, reached)
            self._now = reached
            is_event |= event is not None and math.isclose(reached, event)
            if self._exchange.completes:
                action = f"the step from {time:g} s"
                has_event, self._ended = self._call(action, self._fmu.completedIntegratorStep)
                is_event |= bool(has_event)
            if is_event and not self._ended:
                self._event()
        return self._ended

    def _integrate(self, target: float) -> tuple[bool, float]:
        """Integrate to a time, or to an earlier event; return whether there was an event, and the time."""
        try:
            is_event, _, reached = self._solver.step(self._now, target)
        except Exception as error:  # CVode's failures
            self._check()
            raise FmuError(f"the solver failed after {self._now:g} s: {error}") from error
        self._check()
        return bool(is_event), float(reached)


_GIVE_UP_S = 1.0


class Episodes:
    """Runs episodes one after the other. attachment: see `FmuOptions.attachment`. Raises FmuError."""

    def __init__(self, attachment: Mapping[str, Any]) -> None:
        try:
            self._description = describe(Path(attachment["fmu"]), attachment["start"])
        except InputError as error:
            raise FmuError(str(error)) from error
        self._attachment = attachment
        self._agents: int = attachment["agents"]
        self._size: float = attachment["step"]
        self._instances = self._make(1 if attachment["one"] else self._agents)
        self._sensors = self._variables([sensor["variable"] for sensor in attachment["sensors"]])
        self._actuators = self._variables([actuator["variable"] for actuator in attachment["actuators"]])
        self._columns = self._variables([variable for _, variable in attachment["metrics"].values()])
        acts = attachment["acts"]
        self._acts = [] if acts is None else self._variables([acts])
        self._fitness, self._ended = (
            None if attachment[key] is None else self._description.variables[attachment[key]]
            for key in ("fitness", "ended")
        )
        done = attachment["done"]
        self._done = None if done is None else Expression(done)
        self._episodes_begun = 0

    @property
    def needs_new_process(self) -> bool:
        """Whether an episode may have failed to start because a process can have only a single instance."""
        return self._description.only_once and self._episodes_begun > 1

    def _make(self, count: int) -> Sequence[Instance | Coupled]:
        """Create `count` instances."""
        file, folder = self._attachment["fmu"], Path("fmu").resolve()
        if self._description.version == VERSION:
            system, algorithm = read_system(Path(file)), self._attachment["algorithm"]
            return [Coupled(file, system, folder / str(number), algorithm) for number in range(count)]
        unpack(file, folder)
        names = ["simulation"] if count == 1 else [f"agent {number + 1}" for number in range(count)]
        return [self._instance(folder, name) for name in names]

    def _instance(self, folder: Path, name: str) -> Instance:
        solver = self._attachment["solver"]
        if solver is None:
            return Instance(self._description, folder, name)

        return ExchangeInstance(self._description, folder, name, solver)

    def _variables(self, names: Sequence[str]) -> list[tuple[Instance | Coupled, list[Variable]]]:
        """Return the instance of each agent, and the variables with these names."""
        variables = self._description.variables
        return [
            (
                self._instances[0 if self._attachment["one"] else agent],
                [variables[name.replace("{agent}", str(agent + 1))] for name in names],
            )
            for agent in range(self._agents)
        ]

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Start an episode; return the answer."""
        values = {name: value for name, value in parameters.items() if value is not None}
        start = {**self._attachment["start"], **values}
        if self._attachment["seed"] is not None:
            name = self._attachment["seed"]
            start[name] = reduce_seed(self._description.variables[name], seed)
        self._begin = self._description.start_time
        self._steps_made = 0
        self._episodes_begun += 1
        self._values: list[list[list[float]]] = []
        last = self._begin + self._size * (self._attachment["steps"] - 1)
        # Some FMUs refuse a step that ends later, even by a rounding error.
        stop = max(self._begin + self._size * self._attachment["steps"], last + self._size)
        for instance in self._instances:
            instance.begin(start, self._begin, stop)
        return self._answer()

    def step(self, actuators: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Advance by one step; return the answer."""
        channels = self._attachment["actuators"]
        for row, (instance, variables) in zip(actuators, self._actuators, strict=True):
            values = [
                convert_actuator(variable, share, _to_actuator_value(channel, share))
                for share, channel, variable in zip(row, channels, variables, strict=False)
            ]
            instance.put(variables, values)
        time = self._begin + self._steps_made * self._size
        ends = [instance.step(time, self._size) for instance in self._instances]
        self._steps_made += 1
        self._values.append([instance.numbers(variables) for instance, variables in self._columns])
        if any(ends) or self._steps_made >= self._attachment["steps"] or self._is_done():
            fitness = {} if self._fitness is None else {"fitness": self._instances[0].get(self._fitness)}
            return {"done": True, "metrics": self._metrics(), **fitness}
        return self._answer()

    def give_up(self) -> None:
        """End the episode, to release simulation servers behind FMUs; with a time-out, as FMUs may hang."""
        thread = threading.Thread(target=self._give_up, daemon=True)
        thread.start()
        thread.join(_GIVE_UP_S)

    def _give_up(self) -> None:
        if any(isinstance(running, Instance) and running.is_corrupted for running in self._instances):
            return  # a fatal error affects all instances of the FMU
        for instance in self._instances:
            instance.give_up()

    def report_waiting_times(self) -> None:
        """Print the waiting times of the components of a system."""
        for instance in self._instances:
            if isinstance(instance, Coupled) and instance.waiting_times:
                print(f"waited for components: {instance.waiting_times}", file=sys.stderr, flush=True)

    def _answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = {"sensors": self._read_sensors()}
        if self._acts:
            acting = (instance.get(actor) for instance, [actor] in self._acts)
            answer["acting"] = [agent for agent, acts in enumerate(acting) if acts]
        elif not self._attachment["actuators"]:
            answer["acting"] = []  # the simulation is stepped without actions
        return answer

    def _read_sensors(self) -> list[list[float]]:
        channels = self._attachment["sensors"]
        rows = []
        for instance, variables in self._sensors:
            values = instance.numbers(variables)
            for value, variable in zip(values, variables, strict=True):
                if not math.isfinite(value):
                    raise FmuError(f"{variable.name} is {value} at {self._time:g} s")
            rows.append(
                [
                    _to_unit(channel, value)
                    if channel["range"] is None
                    else _share(channel["range"], _to_unit(channel, value))
                    for value, channel in zip(values, channels, strict=True)
                ]
            )
        return rows

    @property
    def _time(self) -> float:
        return self._begin + self._steps_made * self._size

    def _metrics(self) -> dict[str, float]:
        metrics = self._reduce_metrics()
        for name, value in metrics.items():
            if not math.isfinite(value):
                function, variable = self._attachment["metrics"][name]
                raise FmuError(f"the metric {name}, {function}({variable}), is {value} at {self._time:g} s")
        return metrics

    def _reduce_metrics(self) -> dict[str, float]:
        """Return all metrics; some may be NaN before the episode ends."""
        metrics = {}
        for index, (name, (function, variable)) in enumerate(self._attachment["metrics"].items()):
            reduce = FUNCTIONS[function]
            # A metric that all agents share is read once: the mean of equal numbers may differ in its last
            # bits.
            shared = self._attachment["one"] and AGENT not in variable
            agents = range(1 if shared else self._agents)
            metrics[name] = mean([reduce([step[agent][index] for step in self._values]) for agent in agents])
        return metrics

    def _is_done(self) -> bool:
        if self._ended is not None and self._instances[0].get(self._ended):
            return True
        if self._done is None:
            return False
        try:
            value = self._done(self._reduce_metrics())
            return not math.isnan(value) and bool(value)
        except (ArithmeticError, ValueError) as error:
            raise FmuError(f"done: {self._done.text}: {error}") from error


def _to_unit(channel: Mapping[str, Any], value: float) -> float:
    """Convert a value of the FMU to the unit of a channel."""
    return value if channel["convert"] is None else channel["convert"][0] * value + channel["convert"][1]


def _from_unit(channel: Mapping[str, Any], value: float) -> float:
    """Convert a value in the unit of a channel to the FMU's unit."""
    return value if channel["convert"] is None else (value - channel["convert"][1]) / channel["convert"][0]


def _to_actuator_value(channel: Mapping[str, Any], share: float) -> float:
    """Return the FMU's value of an actuator, which is -1 to 1 if the channel has a range."""
    return _from_unit(channel, share if channel["range"] is None else _from_share(channel["range"], share))


def _share(limits: Sequence[float], value: float) -> float:
    return 2.0 * (value - limits[0]) / (limits[1] - limits[0]) - 1.0


def _from_share(limits: Sequence[float], value: float) -> float:
    return limits[0] + (value + 1.0) * 0.5 * (limits[1] - limits[0])


def main(arguments: Sequence[str]) -> int:
    """Run episodes until standard input ends; return the exit status."""
    # The FMU's own output must not be mistaken for answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    attachment = json.loads(Path(arguments[0]).read_text("utf-8"))
    episodes: Episodes | None = None
    for line in sys.stdin:
        message = json.loads(line)
        try:
            if episodes is None:
                episodes = Episodes(attachment)
            if "reset" in message:
                answer = episodes.reset(message["reset"]["parameters"], message["reset"]["seed"])
            else:
                answer = episodes.step(message["actuators"])
        except FmuError as error:
            if episodes is not None:
                if "reset" in message and episodes.needs_new_process:
                    break
                episodes.give_up()
            answer = {"error": str(error)}
        number = {"id": message["id"]} if "id" in message else {}
        _write(answers, {**answer, **number})
    if episodes is not None:
        episodes.give_up()
        episodes.report_waiting_times()
    # Libraries of FMUs are not unloaded, because some crash.
    answers.close()
    os._exit(0)


def _write(file: TextIO, answer: Mapping[str, Any]) -> None:
    file.write(f"{json.dumps(answer, separators=(',', ':'))}\n")
    file.flush()
