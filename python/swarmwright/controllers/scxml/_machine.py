"""State machines, and the tables that they are as controllers of the kind `mealy_fsm`.

Statecharts become the table of a Mealy machine.
"""

import ast
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.problems import ProblemLines
from swarmwright.common.suggestions import alike, unknown
from swarmwright.controllers.scxml._chart import Assignment, Event, State, Transition, combinations
from swarmwright.controllers.scxml._conditions import (
    Above,
    Bits,
    Combined,
    Condition,
    ConditionError,
    Thresholds,
    collect,
    condition,
    holds,
    named,
)
from swarmwright.controllers.scxml._steps import Edge, EndlessError, Output, Snapshot, Steps, matches
from swarmwright.controllers.scxml._write import identifiers

_LARGEST_TABLE = 1_000_000
"""Numbers in a table, at most, as in the engine."""
_MOST_STATES = 1000

_MOST_MACHINES = 1000

_Effect = tuple[int, tuple[tuple[int, float], ...]]
"""The state after a step, and the actuators that got a number in it."""


def table(
    root: State,
    edges: dict[int, Edge],
    outputs: dict[int, Output],
    begin: list[Output],
    sensors: int,
    actuators: int,
) -> dict[str, Any]:
    """Return states, thresholds and weights of a controller.

    Args:
        root: the machine.
        edges: its transitions, by their `id`.
        outputs: what its assignments do, by their `id`.
        begin: actuators that have a number before anything is assigned.
        sensors: how many there are.
        actuators: how many there are.

    Raises ValueError when the table is too large, or transitions without an event go in a circle.
    """
    steps, thresholds, rows = steps_of(root, edges, outputs, sensors)
    _check_size(rows * (1 + actuators))
    effects, first = _flattened(root, steps, rows, 1 + actuators)
    kept = [_keeping_actuators(effect, actuators) for effect in effects]
    given = dict([*begin, *first])
    start = tuple(given.get(actuator, 0.0) for actuator in range(actuators))
    variants = _variants(effects, kept, start)
    _check_size(len(variants) * rows * (1 + actuators))
    weights: list[float] = []
    for state, held in variants:
        for target, values in effects[state]:
            numbers = list(held)
            for actuator, value in values:
                numbers[actuator] = value
            weights.append(variants[target, _restricted(numbers, kept[target])])
            weights += [_shortest(number) for number in numbers]
    return {
        "states": len(variants),
        "thresholds": [[_shortest(end) for end in thresholds[sensor]] for sensor in range(sensors)],
        "weights": weights,
    }


def steps_of(
    root: State, edges: dict[int, Edge], outputs: dict[int, Output], sensors: int
) -> tuple[Steps, Thresholds, int]:
    """Return the steps of a machine, where intervals of sensors end, and the number of combinations."""
    thresholds = _thresholds(edges, sensors)
    counts = [len(thresholds[sensor]) + 1 for sensor in range(sensors)]
    rows = math.prod(counts)
    _check_size(rows)
    intervals = np.indices(counts).reshape(sensors, -1)

    def truth(condition: Condition, active: frozenset[str]) -> Bits:
        return holds(condition, thresholds, intervals, active)

    return Steps(root, edges, outputs, truth, rows), thresholds, rows


def _flattened(
    root: State, steps: Steps, rows: int, width: int
) -> tuple[list[list[_Effect]], tuple[Output, ...]]:
    """Return what a step does in each state that can be reached, the first one first, and first outputs."""
    try:
        first, done = steps.begin()
        numbers = {first: 0}
        order = [first]
        if all(inner.is_atomic for inner in root.inner):
            # States side by side stay, too, where no transition leads to them.
            for state in root.inner:
                initial = Snapshot((state.order,))
                if numbers.setdefault(initial, len(order)) == len(order):
                    order.append(initial)
        effects: list[list[_Effect]] = []
        for snapshot in order:  # grows while it is walked through
            found: list[_Effect] = [(0, ())] * rows
            for taken, after, values in steps.step(snapshot):
                if numbers.setdefault(after, len(order)) == len(order):
                    order.append(after)
                effect = (numbers[after], tuple(sorted(dict(values).items())))
                for row in taken.tolist():
                    found[row] = effect
            effects.append(found)
            if len(order) > _MOST_MACHINES:
                raise ValueError(
                    f"more than {_MOST_MACHINES} combinations of active states and remembered ones "
                    f"can be reached ({combinations(root):,} combinations of states are drawn); a controller "
                    "has a state for each: draw fewer parallel regions or histories"
                )
            _check_size(len(order) * rows * width)
    except EndlessError as error:
        raise ValueError(
            f"transitions without an event from the state {error!s} are taken without end for some values of "
            'the sensors; give them event="step" to take one in each control step'
        ) from None
    return effects, done


def _shortest(number: float) -> float:
    """Return the number with the fewest digits that is the same float32."""
    return float(str(np.float32(number)))


def _check_size(numbers: int) -> None:
    if numbers > _LARGEST_TABLE:
        raise ValueError(
            f"the table has {numbers} numbers, at most {_LARGEST_TABLE} are possible; compare fewer sensors, "
            "or with fewer numbers"
        )


def _thresholds(edges: dict[int, Edge], sensors: int) -> Thresholds:
    thresholds: dict[int, set[float]] = {sensor: set() for sensor in range(sensors)}
    for edge in edges.values():
        for guard in (edge.condition, edge.on_step):
            if guard is not None:
                collect(guard, thresholds)
    return {sensor: sorted(ones) for sensor, ones in thresholds.items()}


def _keeping_actuators(effects: list[_Effect], actuators: int) -> tuple[int, ...]:
    """Return the actuators that keep their number in some step of a state."""
    return tuple(
        actuator
        for actuator in range(actuators)
        if any(all(actuator != other for other, _ in values) for _, values in effects)
    )


def _explore(
    begin: tuple[int, tuple[float, ...]],
    effects: list[list[_Effect]],
    kept: list[tuple[int, ...]],
    found: dict[tuple[int, tuple[float, ...]], None],
) -> None:
    """Add a state with what it keeps, and all that can follow."""
    waiting = [begin]
    while waiting:
        waiting_state = waiting.pop()
        if waiting_state in found:
            continue
        found[waiting_state] = None
        if len(found) > _MOST_STATES:
            raise ValueError(
                f"what actuators keep makes more than {_MOST_STATES} states; assign every actuator in each "
                "state"
            )
        state, held = waiting_state
        for target, values in dict.fromkeys(effects[state]):
            outputs = list(held)
            for actuator, value in values:
                outputs[actuator] = value
            waiting.append((target, _restricted(outputs, kept[target])))


def _restricted(outputs: list[float] | tuple[float, ...], kept: tuple[int, ...]) -> tuple[float, ...]:
    """Return outputs with 0 for those that a state does not keep."""
    return tuple(value if actuator in kept else 0.0 for actuator, value in enumerate(outputs))


def _variants(
    effects: list[list[_Effect]], kept: list[tuple[int, ...]], start: tuple[float, ...]
) -> dict[tuple[int, tuple[float, ...]], int]:
    """Return the number of each state with what it keeps: the initial one first, then by state."""
    first = (0, _restricted(start, kept[0]))
    found: dict[tuple[int, tuple[float, ...]], None] = {}
    for state in range(len(effects)):
        # States that no transition leads to stay, too.
        if not any(reached == state for reached, _ in found):
            _explore(first if state == 0 else (state, tuple(0.0 for _ in start)), effects, kept, found)
    order = sorted(found, key=lambda key: (key != first, key[0]))
    return {position: index for index, position in enumerate(order)}


EVENT = "step"
"""The event of each control step, at which sensors have new values."""
EVENTS = frozenset({EVENT, "*"})


@dataclass
class StateMachine:
    """A state machine as a file has it; sensors and actuators are names."""

    path: Path
    name: str
    root: State
    declared: dict[str, float | None] = field(default_factory=dict)
    """Data: name -> a number, or None for data without a value."""

    @property
    def states(self) -> dict[str, State]:
        """All states, without histories, by name."""
        return {state.name: state for state in self.root.all() if state.kind not in {"scxml", "history"}}

    @property
    def assigned(self) -> list[str]:
        """Names of actuators: those declared first, in their order, then in the order of their use."""
        actions = (action for state in self.root.all() for action in state.actions)
        used = [action.actuator for action in actions if isinstance(action, Assignment)]
        return list(dict.fromkeys([*(name for name in self.declared if name in used), *used]))

    @property
    def sensors(self) -> list[str]:
        """Names of sensors, as declared: data without a number that is not assigned."""
        assigned = set(self.assigned)
        return [name for name, value in self.declared.items() if value is None and name not in assigned]

    def specification(self, sensors: Sequence[str] = (), actuators: Sequence[str] = ()) -> dict[str, Any]:
        """Return the controller, see protocol/schemas/controller.schema.json.

        In each control step sensors get their values, then the event `step` occurs; all that follows is by
        SCXML's algorithm: transitions without an event, then events that the machine gave to itself, until
        none is left. Each combination of states that are active together, with what histories remember, is a
        state of the controller. Actuators keep their numbers until they get others, 0 at first. Where what an
        actuator keeps depends on the way into a state, the table has this state several times.

        Args:
            sensors: names in the order of the simulation's sensors; default: those that the file declares.
            actuators: names in the order of the simulation's actuators; default: those that are assigned.

        Raises InputError with every name that there is not, every condition that is not supported,
        transitions that go in a circle, and too many states; file and line each.
        """
        return _Resolved(
            self, list(sensors) or self.sensors, list(actuators) or self.assigned
        ).specification()


def in_expression(name: str) -> str:
    """Return a name as Python's parser gives it, in Unicode's form NFKC."""
    return unicodedata.normalize("NFKC", name)


class _Resolved:
    """A machine with numbers in the place of names."""

    def __init__(self, machine: StateMachine, sensors: list[str], actuators: list[str]) -> None:
        self.machine = machine
        self.sensors, self.actuators = sensors, actuators
        self.problems = ProblemLines()
        self.exported = self._exported()
        self.first = self._first_numbers()
        self.constants = {
            in_expression(name): value
            for name, value in machine.declared.items()
            if value is not None and name not in self.first
        }
        self.all = {state.name: state for state in machine.root.all()}
        self.given = self._given()

    def specification(self) -> dict[str, Any]:
        machine = self.machine
        for what, names in (("sensors", self.sensors), ("actuators", self.actuators)):
            if not names:
                self.problems.add(f'{machine.path}: names no {what}; declare them, <data id="NAME"/>')
        edges, outputs = self.parts()
        begin = [(self._numbered(name), value) for name, value in self._initial()]
        self.problems.stop()
        try:
            made = table(machine.root, edges, outputs, begin, len(self.sensors), len(self.actuators))
        except ValueError as error:
            raise InputError(f"{machine.path}: {error}") from None
        return {
            "version": 1,
            "kind": "mealy_fsm",
            "sensors": len(self.sensors),
            "actuators": len(self.actuators),
            **made,
        }

    def parts(self) -> tuple[dict[int, Edge], dict[int, tuple[int, float]]]:
        """Return transitions and assignments, by their `id`."""
        states = self.machine.root.all()
        edges = {
            id(transition): self._edge(state, transition)
            for state in states
            for transition in state.all_transitions
        }
        return edges, self._outputs()

    def _exported(self) -> dict[str, dict[str, int]]:
        """Return what identifiers stand for, of sensors and of actuators, in a file that was exported.

        Such a file declares each identifier that the export makes of the names; others have none.
        """
        words = identifiers([*self.sensors, *self.actuators], list(self.machine.states))
        if not set(words) <= set(self.machine.declared):
            return {}
        count = len(self.sensors)
        return {
            "sensor": {word: index for index, word in enumerate(words[:count])},
            "actuator": {word: index for index, word in enumerate(words[count:])},
        }

    def _first_numbers(self) -> dict[str, float]:
        """Return the data that are first numbers of actuators: named as what is assigned, or like it."""
        assigned = self.machine.assigned
        # What is declared itself has no other data that are only like it.
        others = [name for name in assigned if name not in self.machine.declared]
        return {
            name: value
            for name, value in self.machine.declared.items()
            if value is not None and (name in assigned or alike(name, others))
        }

    def _initial(self) -> list[tuple[str, float]]:
        """Return the numbers that declared actuators have before anything is assigned."""
        for name, value in self.first.items():
            if abs(value) > 1:
                self.problems.add(
                    f"{self.machine.path}: <data>: {name} is {value:g}, expected -1 to 1, the range of "
                    "an actuator"
                )
        return list(self.first.items())

    def _outputs(self) -> dict[int, tuple[int, float]]:
        """Return the actuator and its number of each action that assigns one."""
        outputs = {}
        for state in self.machine.root.all():
            for action in state.actions:
                if isinstance(action, Assignment):
                    number = self._number(action.actuator, self.actuators, "actuator", action.line)
                    if number is None:
                        self._unknown(action.line, "actuator", action.actuator, self.actuators)
                    outputs[id(action)] = (-1 if number is None else number, action.value)
        return outputs

    def _numbered(self, actuator: str) -> int:
        """Return the number of an actuator, -1 for none."""
        number = self._number(actuator, self.actuators, "actuator")
        return -1 if number is None else number

    def _edge(self, source: State, transition: Transition) -> Edge:
        edge = Edge(source, transition, [self.all[target] for target in transition.targets])
        if transition.condition is not None:
            try:
                edge.condition = condition(
                    transition.condition, partial(self._sensor, transition.line), self.constants
                )
            except ConditionError as error:
                self.problems.add(f"{self.machine.path}:{transition.line}: <transition>: cond: {error}")
            for name in sorted(named(edge.condition) - self.machine.states.keys()):
                self.problems.add(
                    f"{self.machine.path}:{transition.line}: <transition>: cond: In({name!r}): "
                    f"{unknown('state', name, list(self.machine.states))}"
                )
        trigger = self._trigger(transition)
        if trigger is not None:
            parts = tuple(part for part in (trigger, edge.condition) if part is not True)
            edge.on_step = True if not parts else parts[0] if len(parts) == 1 else Combined("and", parts)
        compared: dict[int, set[float]] = {}
        collect(edge.condition, compared)
        edge.compares = bool(compared)
        return edge

    def _trigger(self, transition: Transition) -> Condition | None:
        """Return when the event of a control step triggers a transition; None for never."""
        found: list[Condition] = []
        for event in transition.events:
            if event in EVENTS:
                return True
            if any(matches(event, given) for given in self.given):
                continue
            number = self._number(event, self.sensors, "sensor", transition.line)
            if number is None:
                self._unknown(transition.line, "event", event, ["step", *sorted(self.given), *self.sensors])
            else:
                found.append(Above(number, 0.0))
        return None if not found else found[0] if len(found) == 1 else Combined("or", tuple(found))

    def _given(self) -> set[str]:
        """Return the names of the events that the machine gives to itself."""
        found = set()
        for state in self.machine.root.all():
            if state.kind == "final" and state.parent is not None and state.parent is not self.machine.root:
                found.add(f"done.state.{state.parent.name}")
                if state.parent.parent is not None and state.parent.parent.kind == "parallel":
                    found.add(f"done.state.{state.parent.parent.name}")
            found |= {action.name for action in state.actions if isinstance(action, Event)}
        return found

    def _sensor(self, line: int, node: ast.expr) -> int | None:
        match node:
            case ast.Name(id=name) if name not in self.constants:
                number = self._number(
                    name, [in_expression(sensor) for sensor in self.sensors], "sensor", line
                )
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
                self.problems.add(
                    f"{self.machine.path}:{line}: there is no sensors[{index}]; there are "
                    f"{len(self.sensors)} sensors"
                )
                return 0
        return None

    def _number(self, name: str, names: list[str], what: str, line: int | None = None) -> int | None:
        """Return the number of a sensor or an actuator; None for none.

        what: `sensor` or `actuator`. line: where an ambiguous name is reported, the first of them is taken.
        """
        indexed = re.fullmatch(rf"{what}s?\[(\d{{1,6}})\]", name)
        if indexed is not None and int(indexed[1]) < len(names):
            return int(indexed[1])
        exported = self.exported.get(what, {})
        if name in exported:
            return exported[name]
        found = alike(name, names)
        if len(found) > 1 and line is not None:
            written = self.sensors if what == "sensor" else self.actuators
            which = " or ".join(repr(written[index]) for index in found)
            instead = " or ".join(f"{what}s[{index}]" for index in found)
            self.problems.add(
                f"{self.machine.path}:{line}: the {what} {name!r} may be {which}; write {instead}"
            )
        return found[0] if found else None

    def _unknown(self, line: int, what: str, name: str, names: list[str]) -> None:
        self.problems.add(f"{self.machine.path}:{line}: {unknown(what, name, names)}")
