"""The state machines and trees of controllers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarmwright.core.modules import (
    State,
    condition_words,
    is_modules,
    is_tree,
    name_of,
    states_of,
    words_of,
)
from swarmwright.core.teams import is_team, parts_of

_MOST_STATES = 64
"""States of a machine that is drawn."""


def groups_of(specification: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Return the groups of a team that have state machines, with these; None for what is no such team.

    first, end: between which agents they are; end is None for all others.
    """
    if not is_team(specification):
        return None
    first: int | None = 0
    found = []
    for group, part in zip(specification["groups"], parts_of(specification).values(), strict=True):
        agents = group.get("agents")
        end = None if first is None or agents is None else first + int(agents)
        if has_states(part):
            found.append({"name": group["name"], "first": first, "end": end, "machine": machine_of(part, -1)})
        first = end
    return found or None


def state_names(specification: Mapping[str, Any]) -> list[str]:
    """Return what the states of a controller are called; those of a team's groups are joined with a slash."""
    if is_team(specification):
        machines = [group["machine"] for group in groups_of(specification) or ()]
    else:
        machines = [machine_of(specification, -1)]
    most = max((len(machine["states"]) for machine in machines), default=0)
    names = []
    for index in range(most):
        named = (machine["states"][index]["name"] for machine in machines if index < len(machine["states"]))
        names.append(" / ".join(dict.fromkeys(name for name in named if name)))
    return names


def has_states(specification: Mapping[str, Any]) -> bool:
    """Whether a controller is a state machine that is known and not too large to be drawn."""
    states = specification["states"] if specification.get("kind") == "mealy_fsm" else 0
    return is_modules(specification) or 0 < states <= _MOST_STATES


def machine_of(specification: Mapping[str, Any], highest: int) -> dict[str, Any]:
    """Return a state machine: names and words of states, and transitions as [from, to, words].

    A tree has subtrees in the place of states, with their conditions in words, and no transitions.

    highest: the last state that an agent was in, for machines of which no more is known.
    """
    if is_modules(specification):
        found = states_of(specification)
        if is_tree(specification):
            return _tree(found)
        return {
            "states": [{"name": name_of(state.behaviour), "words": words_of(state)} for state in found],
            "transitions": [
                (index, one.target, words_of(one).partition(": ")[2])
                for index, state in enumerate(found)
                for one in state.transitions
            ],
        }
    if has_states(specification):
        count = specification["states"]
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
    names = [{"name": "", "words": f"state {index}"} for index in range(highest + 1)]
    return {"states": names, "transitions": []}


def _tree(subtrees: Sequence[State]) -> dict[str, Any]:
    return {
        "form": "tree",
        "states": [
            {
                "name": name_of(one.behaviour),
                "words": words_of(one),
                "condition": condition_words(one),
            }
            for one in subtrees
        ],
        "transitions": [],
    }
