"""The state machines and trees of controllers."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.display._scene import Bodies

STATE_COLORS = (
    "#0072B2", "#880044", "#99BB00", "#9900FF", "#CC7799", "#555500", "#55BBEE", "#FF6666",
    "#221188", "#BB55FF", "#AAEE77", "#663300", "#DD2244", "#881177", "#DDCC99", "#0033FF",
    "#EEDD00", "#773355", "#446633", "#DD9955", "#AA77EE", "#FF77DD", "#2255BB", "#00EEDD",
)  # fmt: skip
"""Colours by state. The first eight can be told apart with protanopia, deuteranopia and tritanopia, too:
simulated with the matrices of Machado, Oliveira and Fernandes (2009), their CIE76 differences are at least
25; their contrast to white and to the background of maps is at least 2. The others differ from all by at
least 15 in full colour vision."""

DISTINCT_STATES = 8
"""Number of leading STATE_COLORS that are distinguishable with every kind of colour vision."""


def state_color(state: int) -> str:
    """Return the colour of a state, as '#0072B2'; colours repeat for more states."""
    return STATE_COLORS[state % len(STATE_COLORS)]


Machine = Mapping[str, Any]
"""`states`: the `name` and `words` of each; `transitions`: (from, to, words) of each.

A tree has the `form` "tree", subtrees instead of states, with their `condition` in words, and no transitions.
"""


@dataclass(frozen=True)
class Group:
    """Agents of a team with the same controller.

    first, end: range of their agents; end is None for all remaining agents, first if unknown.
    machine: None for a controller without states.
    """

    name: str
    first: int | None
    end: int | None
    machine: Machine | None


@dataclass(frozen=True)
class Machines:
    """The state machines of the controllers of an episode.

    kind: kind of the controller, for messages; empty if unknown. machine: of all agents; None for a
    controller without states, or too large to draw. groups: groups of a team; None for any other controller.
    """

    kind: str = ""
    machine: Machine | None = None
    groups: tuple[Group, ...] | None = None

    @cached_property
    def groups_with_colors(self) -> list[dict[str, Any]] | None:
        """The groups of a team with their state machines; None without state machines.

        The `first_color` of a machine is the index of the colour of its state 0: the colours of a group
        follow those of the previous groups.
        """
        color = 0
        groups = []
        for group in self.groups or ():
            if group.machine is not None:
                machine = {**group.machine, "first_color": color}
                color += len(machine["states"])
                groups.append(
                    {"name": group.name, "first": group.first, "end": group.end, "machine": machine}
                )
        return groups or None

    def common_machine(self, highest: int) -> Machine:
        """Return the machine of all agents.

        highest: highest state of an agent, used if the machine is unknown.
        """
        if self.machine is not None:
            return self.machine
        names = [{"name": "", "words": f"state {index}"} for index in range(highest + 1)]
        return {"states": names, "transitions": []}


@dataclass(frozen=True)
class StateColors:
    """Colours of controller states, different for each group of a team.

    labels: labels of the colours in legends. first: (agents,), index of the colour of an agent's state 0.
    """

    labels: tuple[str, ...]
    first: NDArray[np.int64]

    @classmethod
    def from_machines(
        cls, machines: Machines, states: NDArray[np.signedinteger[Any]], bodies: Bodies
    ) -> Self:
        """Return the colours of an episode.

        machines: machines of the controllers. states: (scenes, agents), -1 for agents whose controllers have
        no states. bodies: bodies of the first scene, whose names identify the group of an agent.
        """
        first = np.zeros(states.shape[1], dtype=np.int64)
        groups = machines.groups_with_colors
        if groups is None:
            states_of_all = machines.common_machine(-1)["states"] if machines.groups is None else []
            names = [state["name"] for state in states_of_all]
            names += [""] * (int(states.max(initial=0)) + 1 - len(names))
            return cls(tuple(_label(index, name) for index, name in enumerate(names)), first)
        agents = np.arange(len(first))
        for group in reversed(groups):
            begin, end = group["first"], group["end"]
            if begin is not None:
                first[(agents >= begin) & (agents < (len(first) if end is None else end))] = group["machine"][
                    "first_color"
                ]
        agent_of_body = bodies.agents()
        for group in groups:
            has_name = np.array([group["name"] in look for look in bodies.looks], dtype=bool)
            group_agents = agent_of_body[has_name[bodies.look]] if len(has_name) else agent_of_body[:0]
            first[group_agents[(group_agents >= 0) & (group_agents < len(first))]] = group["machine"][
                "first_color"
            ]
        labels = [
            f"{group['name']} {_label(index, state['name'])}"
            for group in groups
            for index, state in enumerate(group["machine"]["states"])
        ]
        return cls(tuple(labels), first)


def _label(index: int, name: str) -> str:
    return f"{index} {name}" if name else f"state {index}"
