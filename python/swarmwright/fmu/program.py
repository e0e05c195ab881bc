"""Episodes of an FMU, in lines of JSON over standard input and output, see `commands/stepwise.py`."""

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from swarmwright.core.errors import InputError
from swarmwright.fmu.description import Variable, described
from swarmwright.fmu.instances import FmuError, Instance, unpacked
from swarmwright.ros.expression import Expression
from swarmwright.ros.reductions import FUNCTIONS, mean

_SEEDS = 2**31


class Episodes:
    """Episodes in turn. attachment: see `FmuOptions.attachment`. Raises FmuError."""

    def __init__(self, attachment: Mapping[str, Any]) -> None:
        try:
            self._known = described(Path(attachment["fmu"]))
        except InputError as error:
            raise FmuError(str(error)) from error
        self._attachment = attachment
        self._agents: int = attachment["agents"]
        self._size: float = attachment["step"]
        folder = unpacked(attachment["fmu"], Path("fmu").resolve())
        count = 1 if attachment["one"] else self._agents
        self._instances = [
            Instance(self._known, folder, f"agent {number + 1}" if count > 1 else "simulation")
            for number in range(count)
        ]
        self._sensors = [self._variables(one["variable"]) for one in attachment["sensors"]]
        self._actuators = [self._variables(one["variable"]) for one in attachment["actuators"]]
        self._columns = {name: self._variables(one) for name, (_, one) in attachment["metrics"].items()}
        done = attachment["done"]
        self._done = None if done is None else Expression(done)

    def _variables(self, name: str) -> list[tuple[Instance, Variable]]:
        """Return a variable of each agent."""
        variables = self._known.variables
        if "{agent}" in name:
            names = [name.replace("{agent}", str(agent + 1)) for agent in range(self._agents)]
            return [(self._instances[0], variables[one]) for one in names]
        return [(instance, variables[name]) for instance in self._instances]

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Begin an episode; return the answer."""
        start = {**self._attachment["start"], **parameters}
        if self._attachment["seed"] is not None:
            start[self._attachment["seed"]] = seed % _SEEDS
        self._begin = self._known.start_time
        self._made = 0
        self._values: dict[str, list[list[float]]] = {name: [] for name in self._columns}
        stop = self._begin + self._size * self._attachment["steps"]
        for instance in self._instances:
            instance.begin(start, self._begin, stop)
        return self._answer()

    def step(self, actuators: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Go on by a step; return the answer."""
        for index, channel in enumerate(self._attachment["actuators"]):
            limits = channel["range"]
            for row, (instance, variable) in zip(actuators, self._actuators[index], strict=True):
                value = float(row[index])
                if limits is not None:
                    value = limits[0] + (value + 1.0) * 0.5 * (limits[1] - limits[0])
                instance.set(variable, value)
        time = self._begin + self._made * self._size
        ends = [instance.step(time, self._size) for instance in self._instances]
        self._made += 1
        for name, variables in self._columns.items():
            self._values[name].append([instance.get(variable) for instance, variable in variables])
        if any(ends) or self._made >= self._attachment["steps"] or self._is_done():
            return {"done": True, "metrics": self._metrics()}
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        # Without actuators nobody acts, and the simulation is stepped all the same.
        return {"sensors": self._sensed(), **({} if self._actuators else {"acting": []})}

    def _sensed(self) -> list[list[float]]:
        columns = []
        for channel, variables in zip(self._attachment["sensors"], self._sensors, strict=True):
            column = [instance.get(variable) for instance, variable in variables]
            for value, (_, variable) in zip(column, variables, strict=True):
                if not math.isfinite(value):
                    raise FmuError(f"{variable.name} is {value} at {self._time:g} s")
            if channel["range"] is not None:
                low, high = channel["range"]
                column = [2.0 * (value - low) / (high - low) - 1.0 for value in column]
            columns.append(column)
        return [list(row) for row in zip(*columns, strict=True)]

    @property
    def _time(self) -> float:
        return self._begin + self._made * self._size

    def _metrics(self) -> dict[str, float]:
        found = {}
        for name, (function, variable) in self._attachment["metrics"].items():
            reduce = FUNCTIONS[function]
            value = mean([reduce(column) for column in zip(*self._values[name], strict=True)])
            if not math.isfinite(value):
                raise FmuError(f"the metric {name}, {function}({variable}), is {value} at {self._time:g} s")
            found[name] = value
        return found

    def _is_done(self) -> bool:
        if self._done is None:
            return False
        try:
            return bool(self._done(self._metrics()))
        except (ArithmeticError, ValueError) as error:
            raise FmuError(f"done: {self._done.text}: {error}") from error


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
            answer = {"error": str(error)}
        _write(answers, answer)
    # Libraries of FMUs are not unloaded: some do not survive that.
    answers.close()
    os._exit(0)


def _write(file: TextIO, answer: Mapping[str, Any]) -> None:
    file.write(f"{json.dumps(answer, separators=(',', ':'))}\n")
    file.flush()
