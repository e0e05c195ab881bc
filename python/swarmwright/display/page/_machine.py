"""State machines as the page's script reads them."""

from collections.abc import Sequence
from typing import Any

from swarmwright.display._machine import machine_of
from swarmwright.display._part import Part
from swarmwright.display._trace import Trace
from swarmwright.display.page._series import packed


def machine_data(trace: Trace, keys: Sequence[int], part: Part) -> dict[str, Any] | None:
    """Return the state machine of an episode's agents; None for a controller without states.

    states: name and words of each; transitions: [from, to, words]; form: "tree" for a behaviour tree;
    agents, at: (scenes, agents) states that agents are in.
    """
    if trace.states is None:
        return None
    states = trace.states[list(keys)]
    made = machine_of(part.controller, int(trace.states.max(initial=0)))
    return {**made, "agents": states.shape[1], "at": packed(states.reshape(-1), "u1")}
