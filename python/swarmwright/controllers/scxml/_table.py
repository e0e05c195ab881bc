"""Statecharts become the table of a Mealy machine."""

import math
from typing import Any

import numpy as np

from swarmwright.controllers.scxml._chart import State, combinations
from swarmwright.controllers.scxml._conditions import Bits, Condition, Thresholds, collect, holds
from swarmwright.controllers.scxml._steps import Edge, EndlessError, Output, Snapshot, Steps

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
    kept = [_keeping_actuators(one, actuators) for one in effects]
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
        if all(one.is_atomic for one in root.inner):
            # States side by side stay, too, where no transition leads to them.
            for state in root.inner:
                one = Snapshot((state.order,))
                if numbers.setdefault(one, len(order)) == len(order):
                    order.append(one)
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
    found: dict[int, set[float]] = {sensor: set() for sensor in range(sensors)}
    for edge in edges.values():
        for condition in (edge.condition, edge.on_step):
            if condition is not None:
                collect(condition, found)
    return {sensor: sorted(ones) for sensor, ones in found.items()}


def _keeping_actuators(effects: list[_Effect], actuators: int) -> tuple[int, ...]:
    """Return the actuators that keep their number in some step of a state."""
    return tuple(
        actuator
        for actuator in range(actuators)
        if any(all(actuator != one for one, _ in values) for _, values in effects)
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
        one = waiting.pop()
        if one in found:
            continue
        found[one] = None
        if len(found) > _MOST_STATES:
            raise ValueError(
                f"what actuators keep makes more than {_MOST_STATES} states; assign every actuator in each "
                "state"
            )
        state, held = one
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
    order = sorted(found, key=lambda one: (one != first, one[0]))
    return {one: index for index, one in enumerate(order)}
