"""Conversion of statecharts into the tables of controllers of the kind `mealy_fsm`."""

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
from swarmwright.controllers.scxml._chart import Assignment, Event, State, Transition, count_configurations
from swarmwright.controllers.scxml._conditions import (
    Above,
    Bits,
    Combined,
    Condition,
    ConditionError,
    Thresholds,
    collect_thresholds,
    convert_condition,
    evaluate_condition,
    state_names,
)
from swarmwright.controllers.scxml._steps import Edge, EndlessError, Output, Snapshot, Steps, matches
from swarmwright.controllers.scxml._write import make_identifiers

_LARGEST_TABLE = 1_000_000
"""Largest number of values in a table, as in the engine."""
_MOST_STATES = 1000

_MOST_MACHINES = 1000

_Effect = tuple[int, tuple[tuple[int, float], ...]]
"""The state after a step, and the numbers that it assigned to actuators."""


def build_table(
    root: State,
    edges: dict[int, Edge],
    outputs: dict[int, Output],
    begin: list[Output],
    sensors: int,
    actuators: int,
) -> dict[str, Any]:
    """Build states, thresholds and weights of a controller.

    Args:
        root: the machine.
        edges: its transitions, by their `id`.
        outputs: actuator and number of its assignments, by their `id`.
        begin: initial numbers of actuators.
        sensors: number of sensors.
        actuators: number of actuators.

    Raises ValueError when the table is too large, or transitions without an event form a cycle.
    """
    steps, thresholds, rows = build_steps(root, edges, outputs, sensors)
    _check_size(rows * (1 + actuators))
    effects, first = _find_effects(root, steps, rows, 1 + actuators)
    kept_actuators = [_find_kept_actuators(effect, actuators) for effect in effects]
    initial_numbers = dict([*begin, *first])
    start = tuple(initial_numbers.get(actuator, 0.0) for actuator in range(actuators))
    variants = _number_variants(effects, kept_actuators, start)
    _check_size(len(variants) * rows * (1 + actuators))
    weights: list[float] = []
    for state, kept_numbers in variants:
        for target, values in effects[state]:
            numbers = list(kept_numbers)
            for actuator, value in values:
                numbers[actuator] = value
            weights.append(variants[target, _mask_outputs(numbers, kept_actuators[target])])
            weights += [_shortest(number) for number in numbers]
    return {
        "states": len(variants),
        "thresholds": [[_shortest(end) for end in thresholds[sensor]] for sensor in range(sensors)],
        "weights": weights,
    }


def build_steps(
    root: State, edges: dict[int, Edge], outputs: dict[int, Output], sensors: int
) -> tuple[Steps, Thresholds, int]:
    """Return the steps of a machine, the thresholds of sensors, and the number of combinations."""
    thresholds = _thresholds(edges, sensors)
    counts = [len(thresholds[sensor]) + 1 for sensor in range(sensors)]
    rows = math.prod(counts)
    _check_size(rows)
    intervals = np.indices(counts).reshape(sensors, -1)

    def truth(condition: Condition, active: frozenset[str]) -> Bits:
        return evaluate_condition(condition, thresholds, intervals, active)

    return Steps(root, edges, outputs, truth, rows), thresholds, rows


def _find_effects(
    root: State, steps: Steps, rows: int, width: int
) -> tuple[list[list[_Effect]], tuple[Output, ...]]:
    """Return the effects of a step in each reachable state, and the outputs of the first entry."""
    try:
        first, first_outputs = steps.begin()
        numbers = {first: 0}
        order = [first]
        if all(inner.is_atomic for inner in root.inner):
            # In a flat machine, unreachable states are kept, too.
            for state in root.inner:
                initial = Snapshot((state.order,))
                if numbers.setdefault(initial, len(order)) == len(order):
                    order.append(initial)
        effects: list[list[_Effect]] = []
        for snapshot in order:  # grows while it is walked through
            state_effects: list[_Effect] = [(0, ())] * rows
            for step_rows, after, values in steps.step(snapshot):
                if numbers.setdefault(after, len(order)) == len(order):
                    order.append(after)
                effect = (numbers[after], tuple(sorted(dict(values).items())))
                for row in step_rows.tolist():
                    state_effects[row] = effect
            effects.append(state_effects)
            if len(order) > _MOST_MACHINES:
                raise ValueError(
                    f"more than {_MOST_MACHINES} combinations of active and remembered states are "
                    f"reachable ({count_configurations(root):,} combinations of states in the file), and "
                    "each needs a state of the controller; use fewer parallel regions or histories"
                )
            _check_size(len(order) * rows * width)
    except EndlessError as error:
        raise ValueError(
            f"transitions without an event from the state {error!s} form an endless loop for some values of "
            'the sensors; add event="step" to take one in each control step'
        ) from None
    return effects, first_outputs


def _shortest(number: float) -> float:
    """Return the number with the fewest digits that is the same float32."""
    return float(str(np.float32(number)))


def _check_size(numbers: int) -> None:
    if numbers > _LARGEST_TABLE:
        raise ValueError(
            f"the table has {numbers} numbers, but the limit is {_LARGEST_TABLE}; compare fewer sensors, or "
            "with fewer thresholds"
        )


def _thresholds(edges: dict[int, Edge], sensors: int) -> Thresholds:
    thresholds: dict[int, set[float]] = {sensor: set() for sensor in range(sensors)}
    for edge in edges.values():
        for guard in (edge.condition, edge.on_step):
            if guard is not None:
                collect_thresholds(guard, thresholds)
    return {sensor: sorted(bounds) for sensor, bounds in thresholds.items()}


def _find_kept_actuators(effects: list[_Effect], actuators: int) -> tuple[int, ...]:
    """Return the actuators that keep their number in some step of a state."""
    return tuple(
        actuator
        for actuator in range(actuators)
        if any(actuator not in dict(values) for _, values in effects)
    )


def _explore(
    begin: tuple[int, tuple[float, ...]],
    effects: list[list[_Effect]],
    kept_actuators: list[tuple[int, ...]],
    variants: dict[tuple[int, tuple[float, ...]], None],
) -> None:
    """Add a state with its kept numbers, and all its successors."""
    waiting = [begin]
    while waiting:
        waiting_state = waiting.pop()
        if waiting_state in variants:
            continue
        variants[waiting_state] = None
        if len(variants) > _MOST_STATES:
            raise ValueError(
                f"actuators that keep their numbers lead to more than {_MOST_STATES} states; assign every "
                "actuator in each state"
            )
        state, kept_numbers = waiting_state
        for target, values in dict.fromkeys(effects[state]):
            outputs = list(kept_numbers)
            for actuator, value in values:
                outputs[actuator] = value
            waiting.append((target, _mask_outputs(outputs, kept_actuators[target])))


def _mask_outputs(
    outputs: list[float] | tuple[float, ...], kept_actuators: tuple[int, ...]
) -> tuple[float, ...]:
    """Return outputs, 0 for actuators that the state does not keep."""
    return tuple(value if actuator in kept_actuators else 0.0 for actuator, value in enumerate(outputs))


def _number_variants(
    effects: list[list[_Effect]], kept_actuators: list[tuple[int, ...]], start: tuple[float, ...]
) -> dict[tuple[int, tuple[float, ...]], int]:
    """Number each state with its kept numbers: the initial state first, then by state."""
    first = (0, _mask_outputs(start, kept_actuators[0]))
    variants: dict[tuple[int, tuple[float, ...]], None] = {}
    for state in range(len(effects)):
        # Unreachable states are kept, too.
        if not any(reached == state for reached, _ in variants):
            _explore(
                first if state == 0 else (state, tuple(0.0 for _ in start)), effects, kept_actuators, variants
            )
    order = sorted(variants, key=lambda key: (key != first, key[0]))
    return {position: index for index, position in enumerate(order)}


EVENT = "step"
"""The event of each control step, after sensors are updated."""
EVENTS = frozenset({EVENT, "*"})


@dataclass
class StateMachine:
    """A state machine of a file, with sensors and actuators by name."""

    path: Path
    name: str
    root: State
    declared: dict[str, float | None] = field(default_factory=dict)
    """Declared data: name -> number, or None without a value."""

    @property
    def states(self) -> dict[str, State]:
        """All states, without histories, by name."""
        return {state.name: state for state in self.root.walk() if state.kind not in {"scxml", "history"}}

    @property
    def assigned(self) -> list[str]:
        """Names of actuators: declared actuators in their order, then others in the order of use."""
        actions = (action for state in self.root.walk() for action in state.actions)
        used = [action.actuator for action in actions if isinstance(action, Assignment)]
        return list(dict.fromkeys([*(name for name in self.declared if name in used), *used]))

    @property
    def sensors(self) -> list[str]:
        """Names of sensors: declared data without a value that are never assigned."""
        assigned = set(self.assigned)
        return [name for name, value in self.declared.items() if value is None and name not in assigned]

    def specification(self, sensors: Sequence[str] = (), actuators: Sequence[str] = ()) -> dict[str, Any]:
        """Return the controller, see protocol/schemas/controller.schema.json.

        In each control step sensors are updated, then the event `step` occurs; the rest follows SCXML's
        algorithm: transitions without an event, then events that the machine raised or sent to itself, until
        the queues are empty. Each combination of active states and remembered states of histories is a state
        of the controller. Actuators keep their numbers, initially 0, until they are assigned again. If the
        kept number depends on the path into a state, the table has this state several times.

        Args:
            sensors: names in the order of the simulation's sensors; default: those declared in the file.
            actuators: names in the order of the simulation's actuators; default: those assigned in the file.

        Raises InputError, with file and line, for unknown names, unsupported conditions, cycles of
        transitions without an event, and too many states.
        """
        return _Resolved(
            self, list(sensors) or self.sensors, list(actuators) or self.assigned
        ).specification()


def normalize_name(name: str) -> str:
    """Normalize a name to Unicode's form NFKC, as Python's parser does."""
    return unicodedata.normalize("NFKC", name)


class _Resolved:
    """A machine whose names are resolved to indices."""

    def __init__(self, machine: StateMachine, sensors: list[str], actuators: list[str]) -> None:
        self.machine = machine
        self.sensors, self.actuators = sensors, actuators
        self.problems = ProblemLines()
        self.exported = self._find_exported_identifiers()
        self.first = self._first_numbers()
        self.constants = {
            normalize_name(name): value
            for name, value in machine.declared.items()
            if value is not None and name not in self.first
        }
        self.states_by_name = {state.name: state for state in machine.root.walk()}
        self.own_events = self._collect_own_events()

    def specification(self) -> dict[str, Any]:
        machine = self.machine
        for noun, names in (("sensors", self.sensors), ("actuators", self.actuators)):
            if not names:
                self.problems.add(f'{machine.path}: no {noun} declared; add <data id="NAME"/>')
        edges, outputs = self.parts()
        begin = [(self._actuator_index(name), value) for name, value in self._initial()]
        self.problems.stop()
        try:
            fields = build_table(machine.root, edges, outputs, begin, len(self.sensors), len(self.actuators))
        except ValueError as error:
            raise InputError(f"{machine.path}: {error}") from None
        return {
            "version": 1,
            "kind": "mealy_fsm",
            "sensors": len(self.sensors),
            "actuators": len(self.actuators),
            **fields,
        }

    def parts(self) -> tuple[dict[int, Edge], dict[int, tuple[int, float]]]:
        """Return transitions and assignments, by their `id`."""
        states = self.machine.root.walk()
        edges = {
            id(transition): self._edge(state, transition)
            for state in states
            for transition in state.all_transitions
        }
        return edges, self._outputs()

    def _find_exported_identifiers(self) -> dict[str, dict[str, int]]:
        """Return the indices of the identifiers of sensors and of actuators in an exported file.

        An exported file declares an identifier for each name; the result is empty for other files.
        """
        words = make_identifiers([*self.sensors, *self.actuators], list(self.machine.states))
        if not set(words) <= set(self.machine.declared):
            return {}
        count = len(self.sensors)
        return {
            "sensor": {word: index for index, word in enumerate(words[:count])},
            "actuator": {word: index for index, word in enumerate(words[count:])},
        }

    def _first_numbers(self) -> dict[str, float]:
        """Return the data that are initial numbers of actuators: named like an assigned actuator."""
        assigned = self.machine.assigned
        # Declared actuators have no other data with a similar name.
        undeclared = [name for name in assigned if name not in self.machine.declared]
        return {
            name: value
            for name, value in self.machine.declared.items()
            if value is not None and (name in assigned or alike(name, undeclared))
        }

    def _initial(self) -> list[tuple[str, float]]:
        """Return the initial numbers of declared actuators."""
        for name, value in self.first.items():
            if abs(value) > 1:
                self.problems.add(
                    f"{self.machine.path}: <data>: {name} is {value:g}, expected -1 to 1, the range of "
                    "an actuator"
                )
        return list(self.first.items())

    def _outputs(self) -> dict[int, tuple[int, float]]:
        """Return actuator and number of each assignment, by its `id`."""
        outputs = {}
        for state in self.machine.root.walk():
            for action in state.actions:
                if isinstance(action, Assignment):
                    number = self._number(action.actuator, self.actuators, "actuator", action.line)
                    if number is None:
                        self._unknown(action.line, "actuator", action.actuator, self.actuators)
                    outputs[id(action)] = (-1 if number is None else number, action.value)
        return outputs

    def _actuator_index(self, actuator: str) -> int:
        """Return the index of an actuator, -1 if unknown."""
        number = self._number(actuator, self.actuators, "actuator")
        return -1 if number is None else number

    def _edge(self, source: State, transition: Transition) -> Edge:
        edge = Edge(source, transition, [self.states_by_name[target] for target in transition.targets])
        if transition.condition is not None:
            try:
                edge.condition = convert_condition(
                    transition.condition, partial(self._sensor, transition.line), self.constants
                )
            except ConditionError as error:
                self.problems.add(f"{self.machine.path}:{transition.line}: <transition>: cond: {error}")
            for name in sorted(state_names(edge.condition) - self.machine.states.keys()):
                self.problems.add(
                    f"{self.machine.path}:{transition.line}: <transition>: cond: In({name!r}): "
                    f"{unknown('state', name, list(self.machine.states))}"
                )
        trigger = self._trigger(transition)
        if trigger is not None:
            parts = tuple(part for part in (trigger, edge.condition) if part is not True)
            edge.on_step = True if not parts else parts[0] if len(parts) == 1 else Combined("and", parts)
        compared: dict[int, set[float]] = {}
        collect_thresholds(edge.condition, compared)
        edge.compares = bool(compared)
        return edge

    def _trigger(self, transition: Transition) -> Condition | None:
        """Return the condition under which a control step triggers a transition; None for never."""
        conditions: list[Condition] = []
        for event in transition.events:
            if event in EVENTS:
                return True
            if any(matches(event, own_event) for own_event in self.own_events):
                continue
            number = self._number(event, self.sensors, "sensor", transition.line)
            if number is None:
                self._unknown(
                    transition.line, "event", event, ["step", *sorted(self.own_events), *self.sensors]
                )
            else:
                conditions.append(Above(number, 0.0))
        return (
            None
            if not conditions
            else conditions[0]
            if len(conditions) == 1
            else Combined("or", tuple(conditions))
        )

    def _collect_own_events(self) -> set[str]:
        """Return the names of events that the machine raises or sends to itself."""
        events = set()
        for state in self.machine.root.walk():
            if state.kind == "final" and state.parent is not None and state.parent is not self.machine.root:
                events.add(f"done.state.{state.parent.name}")
                if state.parent.parent is not None and state.parent.parent.kind == "parallel":
                    events.add(f"done.state.{state.parent.parent.name}")
            events |= {action.name for action in state.actions if isinstance(action, Event)}
        return events

    def _sensor(self, line: int, node: ast.expr) -> int | None:
        match node:
            case ast.Name(id=name) if name not in self.constants:
                number = self._number(
                    name, [normalize_name(sensor) for sensor in self.sensors], "sensor", line
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
                    f"{self.machine.path}:{line}: sensors[{index}] does not exist; there are "
                    f"{len(self.sensors)} sensors"
                )
                return 0
        return None

    def _number(self, name: str, names: list[str], noun: str, line: int | None = None) -> int | None:
        """Return the index of a sensor or an actuator; None if unknown.

        noun: `sensor` or `actuator`. line: where an ambiguous name is reported; the first match is returned.
        """
        indexed = re.fullmatch(rf"{noun}s?\[(\d{{1,6}})\]", name)
        if indexed is not None and int(indexed[1]) < len(names):
            return int(indexed[1])
        exported = self.exported.get(noun, {})
        if name in exported:
            return exported[name]
        matching = alike(name, names)
        if len(matching) > 1 and line is not None:
            written = self.sensors if noun == "sensor" else self.actuators
            names_text = " or ".join(repr(written[index]) for index in matching)
            instead = " or ".join(f"{noun}s[{index}]" for index in matching)
            self.problems.add(
                f"{self.machine.path}:{line}: the {noun} {name!r} is ambiguous: {names_text}; write {instead}"
            )
        return matching[0] if matching else None

    def _unknown(self, line: int, noun: str, name: str, names: list[str]) -> None:
        self.problems.add(f"{self.machine.path}:{line}: {unknown(noun, name, names)}")
