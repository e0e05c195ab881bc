"""State machines as the page's script reads them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarmwright.common.teams import is_team
from swarmwright.display._machine import machine_of
from swarmwright.display._part import Part
from swarmwright.display._trace import Trace
from swarmwright.display.page._series import packed

NO_STATE = 255
"""Stands for an agent whose controller has no states."""


def states_data(trace: Trace, keys: Sequence[int]) -> dict[str, Any] | None:
    """Return the states that agents are in; None for controllers without states.

    agents: how many; at: (scenes, agents), NO_STATE for an agent without states.
    """
    if trace.states is None:
        return None
    states = trace.states[list(keys)]
    return {
        "agents": states.shape[1],
        "at": packed(np.where(states < 0, NO_STATE, states).reshape(-1), "u1"),
    }


def machine_data(trace: Trace, part: Part) -> dict[str, Any] | None:
    """Return the state machine of an episode's agents; None for a team, or a controller without states.

    states: name and words of each; transitions: [from, to, words]; form: "tree" for a behaviour tree.
    """
    if trace.states is None or is_team(part.controller):
        return None
    return machine_of(part.controller, int(trace.states.max(initial=0)))
