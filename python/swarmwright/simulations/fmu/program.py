"""Episodes of an FMU, in lines of JSON over standard input and output, see `command/stepwise.py`."""

import json
import math
import os
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.coupled import Coupled
from swarmwright.simulations.fmu.description import Variable
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpacked
from swarmwright.simulations.fmu.layout import AGENT
from swarmwright.simulations.fmu.ssp import VERSION, described, system_of
from swarmwright.simulations.fmu.values import driven, seed_of
from swarmwright.simulations.ros.expression import Expression
from swarmwright.simulations.ros.reductions import FUNCTIONS, mean

_GIVE_UP_S = 1.0


class Episodes:
    """Episodes in turn. attachment: see `FmuOptions.attachment`. Raises FmuError."""

    def __init__(self, attachment: Mapping[str, Any]) -> None:
        try:
            self._known = described(Path(attachment["fmu"]), attachment["start"])
        except InputError as error:
            raise FmuError(str(error)) from error
        self._attachment = attachment
        self._agents: int = attachment["agents"]
        self._size: float = attachment["step"]
        self._instances = self._make(1 if attachment["one"] else self._agents)
        self._sensors = self._variables([one["variable"] for one in attachment["sensors"]])
        self._actuators = self._variables([one["variable"] for one in attachment["actuators"]])
        self._columns = self._variables([variable for _, variable in attachment["metrics"].values()])
        acts = attachment["acts"]
        self._acts = [] if acts is None else self._variables([acts])
        self._fitness, self._ended = (
            None if attachment[key] is None else self._known.variables[attachment[key]]
            for key in ("fitness", "ended")
        )
        done = attachment["done"]
        self._done = None if done is None else Expression(done)
        self._begun = 0

    @property
    def needs_new_process(self) -> bool:
        """Whether the last episode may have failed to begin as a process can have one instance only."""
        return self._known.only_once and self._begun > 1

    def _make(self, count: int) -> Sequence[Instance | Coupled]:
        """Return so many instances."""
        file, folder = self._attachment["fmu"], Path("fmu").resolve()
        if self._known.version == VERSION:
            system, algorithm = system_of(Path(file)), self._attachment["algorithm"]
            return [Coupled(file, system, folder / str(number), algorithm) for number in range(count)]
        unpacked(file, folder)
        names = ["simulation"] if count == 1 else [f"agent {number + 1}" for number in range(count)]
        return [self._instance(folder, name) for name in names]

    def _instance(self, folder: Path, name: str) -> Instance:
        solver = self._attachment["solver"]
        if solver is None:
            return Instance(self._known, folder, name)
        from swarmwright.simulations.fmu.exchange import ExchangeInstance  # noqa: PLC0415 - loads SUNDIALS

        return ExchangeInstance(self._known, folder, name, solver)

    def _variables(self, names: Sequence[str]) -> list[tuple[Instance | Coupled, list[Variable]]]:
        """Return the instance of each agent, and the variables with these names."""
        variables = self._known.variables
        return [
            (
                self._instances[0 if self._attachment["one"] else agent],
                [variables[name.replace("{agent}", str(agent + 1))] for name in names],
            )
            for agent in range(self._agents)
        ]

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Begin an episode; return the answer."""
        given = {name: value for name, value in parameters.items() if value is not None}
        start = {**self._attachment["start"], **given}
        if self._attachment["seed"] is not None:
            name = self._attachment["seed"]
            start[name] = seed_of(self._known.variables[name], seed)
        self._begin = self._known.start_time
        self._made = 0
        self._begun += 1
        self._values: list[list[list[float]]] = []
        last = self._begin + self._size * (self._attachment["steps"] - 1)
        # Some FMUs refuse a step that ends later, also by a rounding error.
        stop = max(self._begin + self._size * self._attachment["steps"], last + self._size)
        for instance in self._instances:
            instance.begin(start, self._begin, stop)
        return self._answer()

    def step(self, actuators: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Go on by a step; return the answer."""
        channels = self._attachment["actuators"]
        for row, (instance, variables) in zip(actuators, self._actuators, strict=True):
            values = [
                driven(variable, share, _of_actuator(one, share))
                for share, one, variable in zip(row, channels, variables, strict=False)
            ]
            instance.put(variables, values)
        time = self._begin + self._made * self._size
        ends = [instance.step(time, self._size) for instance in self._instances]
        self._made += 1
        self._values.append([instance.numbers(variables) for instance, variables in self._columns])
        if any(ends) or self._made >= self._attachment["steps"] or self._is_done():
            own = {} if self._fitness is None else {"fitness": self._instances[0].get(self._fitness)}
            return {"done": True, "metrics": self._metrics(), **own}
        return self._answer()

    def give_up(self) -> None:
        """End the episode, so that simulation servers behind FMUs are free; not for long, an FMU may hang."""
        thread = threading.Thread(target=self._give_up, daemon=True)
        thread.start()
        thread.join(_GIVE_UP_S)

    def _give_up(self) -> None:
        if any(isinstance(one, Instance) and one.is_corrupted for one in self._instances):
            return  # a fatal error is one of all instances of the FMU
        for instance in self._instances:
            instance.give_up()

    def tell_waited(self) -> None:
        """Say how long each component of a system was waited for."""
        for instance in self._instances:
            if isinstance(instance, Coupled) and instance.waited:
                print(f"waited for components: {instance.waited}", file=sys.stderr, flush=True)

    def _answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = {"sensors": self._sensed()}
        if self._acts:
            acting = (instance.get(one) for instance, [one] in self._acts)
            answer["acting"] = [agent for agent, acts in enumerate(acting) if acts]
        elif not self._attachment["actuators"]:
            answer["acting"] = []  # the simulation is stepped all the same
        return answer

    def _sensed(self) -> list[list[float]]:
        channels = self._attachment["sensors"]
        rows = []
        for instance, variables in self._sensors:
            values = instance.numbers(variables)
            for value, variable in zip(values, variables, strict=True):
                if not math.isfinite(value):
                    raise FmuError(f"{variable.name} is {value} at {self._time:g} s")
            rows.append(
                [
                    _in_unit(one, value)
                    if one["range"] is None
                    else _share(one["range"], _in_unit(one, value))
                    for value, one in zip(values, channels, strict=True)
                ]
            )
        return rows

    @property
    def _time(self) -> float:
        return self._begin + self._made * self._size

    def _metrics(self) -> dict[str, float]:
        found = self._measured()
        for name, value in found.items():
            if not math.isfinite(value):
                function, variable = self._attachment["metrics"][name]
                raise FmuError(f"the metric {name}, {function}({variable}), is {value} at {self._time:g} s")
        return found

    def _measured(self) -> dict[str, float]:
        """Return all metrics; some may be NaN before an episode ends."""
        found = {}
        for index, (name, (function, variable)) in enumerate(self._attachment["metrics"].items()):
            reduce = FUNCTIONS[function]
            # One that all agents share is taken once: a mean of equal numbers can have other bits.
            shared = self._attachment["one"] and AGENT not in variable
            agents = range(1 if shared else self._agents)
            found[name] = mean([reduce([step[agent][index] for step in self._values]) for agent in agents])
        return found

    def _is_done(self) -> bool:
        if self._ended is not None and self._instances[0].get(self._ended):
            return True
        if self._done is None:
            return False
        try:
            value = self._done(self._measured())
            return not math.isnan(value) and bool(value)
        except (ArithmeticError, ValueError) as error:
            raise FmuError(f"done: {self._done.text}: {error}") from error


def _in_unit(channel: Mapping[str, Any], value: float) -> float:
    """Return a value of the FMU in the unit of a mapping."""
    return value if channel["convert"] is None else channel["convert"][0] * value + channel["convert"][1]


def _from_unit(channel: Mapping[str, Any], value: float) -> float:
    """Return the FMU's value of one in the unit of a mapping."""
    return value if channel["convert"] is None else (value - channel["convert"][1]) / channel["convert"][0]


def _of_actuator(channel: Mapping[str, Any], share: float) -> float:
    """Return the FMU's value of an actuator, which is -1 to 1 where there is a range."""
    return _from_unit(channel, share if channel["range"] is None else _from_share(channel["range"], share))


def _share(limits: Sequence[float], value: float) -> float:
    return 2.0 * (value - limits[0]) / (limits[1] - limits[0]) - 1.0


def _from_share(limits: Sequence[float], value: float) -> float:
    return limits[0] + (value + 1.0) * 0.5 * (limits[1] - limits[0])


def main(arguments: Sequence[str]) -> int:
    """Run episodes until standard input ends; return the exit status."""
    # An FMU may print: that is no answer.
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
        episodes.tell_waited()
    # Libraries of FMUs are not unloaded: some do not survive that.
    answers.close()
    os._exit(0)


def _write(file: TextIO, answer: Mapping[str, Any]) -> None:
    file.write(f"{json.dumps(answer, separators=(',', ':'))}\n")
    file.flush()
