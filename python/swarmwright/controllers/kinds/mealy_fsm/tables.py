"""The table of a state machine for code generation, and its description."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.source import Evolved
from swarmwright.display.machines import Machine


def machine_tables(controller: Evolved) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the next state of each row of a state machine, and its outputs, (rows, actuators), limited."""
    specification = controller.specification
    rows = controller.weights.reshape(-1, 1 + int(specification["actuators"]))
    states = np.clip(rows[:, 0], 0, int(specification["states"]) - 1)
    return np.trunc(states).astype(np.int64), np.clip(rows[:, 1:], np.float32(-1), np.float32(1))


def visits(
    specification: Mapping[str, Any], rows: NDArray[np.float32], restart: int, least: int
) -> tuple[int, str]:
    """Return after how many steps a state machine visits no new rows, and a description of its coverage.

    Args:
        specification: specification of the controller.
        rows: (steps, sensors).
        restart: steps from reset to reset.
        least: smallest number of steps.
    """
    next_states, _ = machine_tables(Evolved(specification))
    thresholds = [np.array(threshold, np.float32) for threshold in specification["thresholds"]]
    cell = np.zeros(len(rows), np.int64)
    cells = 1
    for sensor, edges in enumerate(thresholds):
        cell = cell * (len(edges) + 1) + (edges[None, :] < rows[:, sensor, None]).sum(axis=1)
        cells *= len(edges) + 1
    visited = np.zeros(len(next_states), np.bool_)
    state, last = 0, 0
    for step, at in enumerate(cell.tolist()):
        if step % restart == 0:
            state = 0
        row = state * cells + at
        if not visited[row]:
            visited[row] = True
            last = step
        state = int(next_states[row])
    steps = min(len(rows), max(least, last + 1))
    states = int(np.unique(np.flatnonzero(visited) // cells).size)
    return steps, (
        f"{steps} pseudo-random steps through {int(visited.sum())} of the {len(next_states)} rows and "
        f"{states} of the {len(next_states) // cells} states of its tables"
    )


def describe(specification: Mapping[str, Any]) -> str:
    """Describe the controller by kind and number of states."""
    return f"{specification['kind']}, {specification.get('states')} states"


_MOST_STATES = 64
"""Largest number of states of a machine that is drawn."""


def machine(specification: Mapping[str, Any]) -> Machine | None:
    """Return the states, and the number of cases in which each leads to another."""
    count = int(specification["states"])
    if count > _MOST_STATES:
        return None
    table = np.array(specification["weights"], dtype=np.float64)
    targets = table.reshape(count, -1, 1 + specification["actuators"])[:, :, 0]
    targets = np.clip(np.floor(targets), 0, count - 1).astype(int)
    return {
        "states": [{"name": "", "words": f"state {index}"} for index in range(count)],
        "transitions": [
            (source, int(target), f"{int(amount)} of {targets.shape[1]} cases")
            for source in range(count)
            for target, amount in zip(*np.unique(targets[source], return_counts=True), strict=True)
        ],
    }
