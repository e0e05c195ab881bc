"""State machines, and the tables that they are as controllers of the kind `mealy_fsm`."""

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.suggestions import unknown
from swarmwright.scxml._conditions import Above, Combined, Condition, ConditionError, condition
from swarmwright.scxml._table import Rules, table


@dataclass(frozen=True)
class Assignment:
    """A number for an actuator."""

    actuator: str
    value: float
    line: int


@dataclass(frozen=True)
class Transition:
    """A transition; without target it stays in its state, which it neither leaves nor enters."""

    line: int
    on_event: bool
    """Whether it waits for the next control step."""
    event: str | None
    """A sensor that is the event: it occurs while the sensor is above 0."""
    condition: ast.expr | None
    target: str | None
    actions: list[Assignment]


@dataclass
class State:
    """A state with what it does."""

    name: str
    line: int
    entry: list[Assignment] = field(default_factory=list)
    exit: list[Assignment] = field(default_factory=list)
    transitions: list[Transition] = field(default_factory=list)


@dataclass
class StateMachine:
    """A state machine as a file has it; sensors and actuators are names."""

    path: Path
    name: str
    initial: str = ""
    declared: dict[str, float | None] = field(default_factory=dict)
    """Data: name -> a number, or None for data without a value."""
    states: dict[str, State] = field(default_factory=dict)

    @property
    def assigned(self) -> list[str]:
        """Names of actuators: those declared first, in their order, then in the order of their use."""
        used = [
            one.actuator
            for state in self.states.values()
            for one in (*state.entry, *state.exit, *(a for t in state.transitions for a in t.actions))
        ]
        return list(dict.fromkeys([*(name for name in self.declared if name in used), *used]))

    @property
    def sensors(self) -> list[str]:
        """Names of sensors, as declared: data without a number that is not assigned."""
        assigned = set(self.assigned)
        return [name for name, value in self.declared.items() if value is None and name not in assigned]

    def specification(self, sensors: Sequence[str] = (), actuators: Sequence[str] = ()) -> dict[str, Any]:
        """Return the controller, see protocol/schemas/controller.schema.json.

        In each control step sensors get their values, then the first transition of the state whose event and
        condition hold is taken, then transitions without an event until none holds. Actuators keep their
        numbers until they get others, 0 at first. Where what an actuator keeps depends on the way into a
        state, the table has this state several times.

        Args:
            sensors: names in the order of the simulation's sensors; default: those that the file declares.
            actuators: names in the order of the simulation's actuators; default: those that are assigned.

        Raises InputError with every name that there is not, every condition that is not supported, and
        transitions that go in a circle; file and line each.
        """
        return _Resolved(
            self, list(sensors) or self.sensors, list(actuators) or self.assigned
        ).specification()


def folded(name: str) -> str:
    """Return a name as it is compared: `goal x`, `goal_x` and `goalX` are the same."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


class _Resolved:
    """A machine with numbers in the place of names."""

    def __init__(self, machine: StateMachine, sensors: list[str], actuators: list[str]) -> None:
        self.machine = machine
        self.sensors, self.actuators = sensors, actuators
        self.problems: list[str] = []
        assigned = {folded(name) for name in machine.assigned}
        self.constants = {
            name: value
            for name, value in machine.declared.items()
            if value is not None and folded(name) not in assigned
        }

    def specification(self) -> dict[str, Any]:
        machine = self.machine
        for what, names in (("sensors", self.sensors), ("actuators", self.actuators)):
            if not names:
                self.problems.append(f'{machine.path}: names no {what}; declare them, <data id="NAME"/>')
        order = [machine.initial, *(name for name in machine.states if name != machine.initial)]
        numbers = {name: index for index, name in enumerate(order)}
        rules = [self._rules(machine.states[name], numbers) for name in order]
        entered = machine.states[machine.initial].entry
        begin = self._values([*self._initial(), *((one.line, one) for one in entered)])
        self._stop()
        try:
            made = table(rules, begin, len(self.sensors), len(self.actuators))
        except ValueError as error:
            raise InputError(f"{machine.path}: {error}") from None
        return {
            "version": 1,
            "kind": "mealy_fsm",
            "sensors": len(self.sensors),
            "actuators": len(self.actuators),
            **made,
        }

    def _initial(self) -> list[tuple[int, Assignment]]:
        """Return the numbers that declared actuators have before anything is assigned."""
        found = []
        for name, value in self.machine.declared.items():
            if value is not None and name not in self.constants:
                if abs(value) > 1:
                    self.problems.append(
                        f"{self.machine.path}: <data>: {name} is {value:g}, expected -1 to 1, the range of "
                        "an actuator"
                    )
                found.append((1, Assignment(name, value, 1)))
        return found

    def _stop(self) -> None:
        if self.problems:
            raise InputError("\n".join(dict.fromkeys(self.problems)))

    def _rules(self, state: State, numbers: dict[str, int]) -> Rules:
        rules = Rules(state.name, numbers[state.name])
        for one in state.transitions:
            target = None if one.target is None else numbers[one.target]
            actions = list(one.actions)
            if one.target is not None:
                actions = [*state.exit, *actions, *self.machine.states[one.target].entry]
            values = self._values([(one.line, action) for action in actions])
            rules.add(self._condition(one), target, values, on_event=one.on_event)
        return rules

    def _values(self, actions: list[tuple[int, Assignment]]) -> dict[int, float]:
        values: dict[int, float] = {}
        for _, one in actions:
            number = self._number(one.actuator, self.actuators, "actuators")
            if number is None:
                self._unknown(one.line, "actuator", one.actuator, self.actuators)
            else:
                values[number] = one.value
        return values

    def _condition(self, one: Transition) -> Condition:
        parts: list[Condition] = []
        if one.event is not None:
            number = self._number(one.event, self.sensors, "sensors")
            if number is None:
                self._unknown(one.line, "event", one.event, ["step", *self.sensors])
            else:
                parts.append(Above(number, 0.0))
        if one.condition is not None:
            try:
                parts.append(condition(one.condition, partial(self._sensor, one.line), self.constants))
            except ConditionError as error:
                self.problems.append(f"{self.machine.path}:{one.line}: <transition>: cond: {error}")
        return True if not parts else parts[0] if len(parts) == 1 else Combined("and", tuple(parts))

    def _sensor(self, line: int, node: ast.expr) -> int | None:
        match node:
            case ast.Name(id=name) if name not in self.constants:
                number = self._number(name, self.sensors, "sensors")
                if number is None:
                    self._unknown(line, "sensor", name, self.sensors)
                return 0 if number is None else number
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="_event"), attr="data"), attr=name):
                return self._sensor(line, ast.Name(id=name))
            case ast.Subscript(
                value=ast.Name(id="sensor" | "sensors"), slice=ast.Constant(value=int() as index)
            ):
                if 0 <= index < len(self.sensors):
                    return index
                self.problems.append(
                    f"{self.machine.path}:{line}: there is no sensors[{index}]; there are "
                    f"{len(self.sensors)} sensors"
                )
                return 0
        return None

    def _number(self, name: str, names: list[str], what: str) -> int | None:
        indexed = re.fullmatch(rf"{what}?\[(\d{{1,6}})\]", name)
        if indexed is not None and int(indexed[1]) < len(names):
            return int(indexed[1])
        by_folded = {folded(one): index for index, one in enumerate(names)}
        return by_folded.get(folded(name))

    def _unknown(self, line: int, what: str, name: str, names: list[str]) -> None:
        self.problems.append(f"{self.machine.path}:{line}: {unknown(what, name, names)}")
