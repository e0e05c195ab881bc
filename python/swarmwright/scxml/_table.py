"""Rules of states become the table of a Mealy machine."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.scxml._conditions import Condition, Thresholds, collect, holds

_LARGEST_TABLE = 1_000_000
"""Numbers in a table, at most, as in the engine."""
_MOST_STATES = 1000

_Effect = tuple[int, tuple[tuple[int, float], ...]]
"""The state after a step, and the actuators that got a number in it."""


@dataclass(frozen=True)
class _Rule:
    condition: Condition
    target: int | None
    values: dict[int, float]
    on_event: bool


@dataclass
class Rules:
    """Transitions of a state, in the order in which they are tried."""

    name: str
    number: int
    found: list[_Rule] = field(default_factory=list)

    def add(
        self, condition: Condition, target: int | None, values: dict[int, float], *, on_event: bool
    ) -> None:
        """Add a transition, and what actuators get by it: of leaving, of itself, of entering."""
        self.found.append(_Rule(condition, target, values, on_event))

    def first(
        self, thresholds: Thresholds, intervals: NDArray[np.int64], *, on_event: bool
    ) -> NDArray[np.int64]:
        """Return the number of the first rule that holds for each combination of intervals, -1 for none."""
        chosen = np.full(intervals.shape[1], -1)
        for index, rule in enumerate(self.found):
            if rule.on_event == on_event:
                chosen[(chosen < 0) & holds(rule.condition, thresholds, intervals)] = index
        return chosen


def table(rules: list[Rules], begin: dict[int, float], sensors: int, actuators: int) -> dict[str, Any]:
    """Return states, thresholds and weights of a controller.

    Args:
        rules: of each state, the initial one first.
        begin: actuators that get a number before the first step.
        sensors: how many there are.
        actuators: how many there are.

    Raises ValueError when the table is too large, or transitions without an event go in a circle.
    """
    thresholds = _thresholds(rules, sensors)
    counts = [len(thresholds[sensor]) + 1 for sensor in range(sensors)]
    _check_size(len(rules) * math.prod(counts) * (1 + actuators))
    intervals = np.indices(counts).reshape(sensors, -1)
    effects = [_effects(rules, state.number, thresholds, intervals) for state in rules]
    kept = [_kept(one, actuators) for one in effects]
    start = tuple(begin.get(actuator, 0.0) for actuator in range(actuators))
    variants = _variants(effects, kept, start)
    _check_size(len(variants) * math.prod(counts) * (1 + actuators))
    weights: list[float] = []
    for state, held in variants:
        for target, values in effects[state]:
            outputs = list(held)
            for actuator, value in values:
                outputs[actuator] = value
            weights.append(variants[target, _restricted(outputs, kept[target])])
            weights += [_shortest(output) for output in outputs]
    return {
        "states": len(variants),
        "thresholds": [[_shortest(end) for end in thresholds[sensor]] for sensor in range(sensors)],
        "weights": weights,
    }


def _shortest(number: float) -> float:
    """Return the number with the fewest digits that is the same float32."""
    return float(str(np.float32(number)))


def _check_size(numbers: int) -> None:
    if numbers > _LARGEST_TABLE:
        raise ValueError(
            f"the table has {numbers} numbers, at most {_LARGEST_TABLE} are possible; compare fewer sensors, "
            "or with fewer numbers"
        )


def _thresholds(rules: list[Rules], sensors: int) -> Thresholds:
    found: dict[int, set[float]] = {sensor: set() for sensor in range(sensors)}
    for state in rules:
        for rule in state.found:
            collect(rule.condition, found)
    return {sensor: sorted(ones) for sensor, ones in found.items()}


def _effects(
    rules: list[Rules], number: int, thresholds: Thresholds, intervals: NDArray[np.int64]
) -> list[_Effect]:
    """Return what a step does in a state, for each combination of intervals."""
    on_event = rules[number].first(thresholds, intervals, on_event=True).tolist()
    without = [state.first(thresholds, intervals, on_event=False).tolist() for state in rules]
    found = []
    for combination, chosen in enumerate(on_event):
        at, values, visited = number, dict[int, float](), set[int]()
        if chosen >= 0:
            rule = rules[number].found[chosen]
            values.update(rule.values)
            at = number if rule.target is None else rule.target
        while (chosen := without[at][combination]) >= 0:
            rule = rules[at].found[chosen]
            if at in visited or rule.target is None:
                raise ValueError(
                    f"transitions without an event from the state {rules[at].name!r} are taken without end "
                    'for some values of the sensors; give them event="step" to take one in each control step'
                )
            visited.add(at)
            values.update(rule.values)
            at = rule.target
        found.append((at, tuple(sorted(values.items()))))
    return found


def _kept(effects: list[_Effect], actuators: int) -> tuple[int, ...]:
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
