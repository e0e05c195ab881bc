"""The state machines of controllers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmwright.core.modules import is_modules, states_of, words_of

_MOST_STATES = 64
"""States of a machine that is drawn."""


def machine_of(specification: Mapping[str, Any], highest: int) -> dict[str, Any]:
    """Return a state machine: names and words of states, and transitions as [from, to, words].

    highest: the last state that an agent was in, for machines of which no more is known.
    """
    kind = specification.get("kind")
    if is_modules(specification):
        found = states_of(specification)
        # A subtree that is done leads to the next one; after the last the tree begins again.
        tree = len(found) if specification.get("form") == "tree" else 0
        return {
            "states": [
                {"name": state.behaviour.replace("_", "-"), "words": words_of(state)} for state in found
            ],
            "transitions": [
                (index, (index + 1) % tree if tree else one.target, words_of(one).partition(": ")[2])
                for index, state in enumerate(found)
                for one in state.transitions
            ],
        }
    if kind == "mealy_fsm" and specification["states"] <= _MOST_STATES:
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
