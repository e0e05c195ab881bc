"""State machines as the page's script reads them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarmwright.core.modules import states_of, words_of
from swarmwright.display._part import Part
from swarmwright.display._trace import Trace
from swarmwright.display.page._series import packed

_MOST_STATES = 64
"""States of a machine that is drawn."""


def machine_data(trace: Trace, keys: Sequence[int], part: Part) -> dict[str, Any] | None:
    """Return the state machine of an episode's agents; None for a controller without states.

    states: name and words of each; transitions: [from, to, words]; agents, at: (scenes, agents) states that
    agents are in.
    """
    if trace.states is None:
        return None
    states = trace.states[list(keys)]
    made = _machine(part, int(trace.states.max(initial=0)))
    return {**made, "agents": states.shape[1], "at": packed(states.reshape(-1), "u1")}


def _machine(part: Part, highest: int) -> dict[str, Any]:
    specification = part.controller
    kind = specification.get("kind")
    if kind == "modules":
        found = states_of(specification)
        return {
            "states": [
                {"name": state.behaviour.replace("_", "-"), "words": words_of(state)} for state in found
            ],
            "transitions": [
                (index, one.target, words_of(one).partition(": ")[2])
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
            "states": [{"name": f"state {index}", "words": f"state {index}"} for index in range(count)],
            "transitions": [
                (source, int(target), f"{int(amount)} of {targets.shape[1]} cases")
                for source in range(count)
                for target, amount in zip(*np.unique(targets[source], return_counts=True), strict=True)
            ],
        }
    names = [{"name": f"state {index}", "words": f"state {index}"} for index in range(highest + 1)]
    return {"states": names, "transitions": []}
