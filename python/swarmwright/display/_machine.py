"""The state machines and trees of controllers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.groups import is_team, parts_of
from swarmwright.common.machine_texts import condition_words, name_of, words_of
from swarmwright.common.modules import State, is_modules, is_tree, states_of
from swarmwright.display._bodies import Bodies
from swarmwright.display.state_colors import colored_states


def groups_of(specification: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Return the groups of a team that have state machines, with these; None for any other controller.

    first, end: between which agents they are; end is None for all others. The `first_color` of a machine is
    the index of the colour of its state 0: the colours of a group follow those of the groups before.
    """
    if not is_team(specification):
        return None
    first: int | None = 0
    color = 0
    found = []
    for group, part in zip(specification["groups"], parts_of(specification).values(), strict=True):
        agents = group.get("agents")
        end = None if first is None or agents is None else first + int(agents)
        if has_states(part):
            machine = {**machine_of(part, -1), "first_color": color}
            color += len(machine["states"])
            found.append({"name": group["name"], "first": first, "end": end, "machine": machine})
        first = end
    return found or None


@dataclass(frozen=True)
class StateColors:
    """The colours of the states of controllers: each group of a team has its own.

    labels: what legends call each colour. first: (agents,), index of the colour of an agent's state 0.
    """

    labels: tuple[str, ...]
    first: NDArray[np.int64]

    @classmethod
    def of(
        cls, specification: Mapping[str, Any], states: NDArray[np.signedinteger[Any]], bodies: Bodies
    ) -> Self:
        """Return the colours of an episode.

        specification: the controller, {} where it is not known. states: (scenes, agents), -1 for agents whose
        controllers have none. bodies: at the first scene, whose names say of which group an agent is.
        """
        first = np.zeros(states.shape[1], dtype=np.int64)
        groups = groups_of(specification)
        if groups is None:
            found = [] if is_team(specification) else machine_of(specification, -1)["states"]
            names = [state["name"] for state in found]
            names += [""] * (int(states.max(initial=0)) + 1 - len(names))
            return cls(tuple(_label(index, name) for index, name in enumerate(names)), first)
        agents = np.arange(len(first))
        for group in reversed(groups):
            begin, end = group["first"], group["end"]
            if begin is not None:
                first[(agents >= begin) & (agents < (len(first) if end is None else end))] = group["machine"][
                    "first_color"
                ]
        of_body = bodies.agents()
        for group in groups:
            named = np.array([group["name"] in look for look in bodies.looks], dtype=bool)
            of_group = of_body[named[bodies.look]] if len(named) else of_body[:0]
            first[of_group[(of_group >= 0) & (of_group < len(first))]] = group["machine"]["first_color"]
        labels = [
            f"{group['name']} {_label(index, state['name'])}"
            for group in groups
            for index, state in enumerate(group["machine"]["states"])
        ]
        return cls(tuple(labels), first)


def _label(index: int, name: str) -> str:
    return f"{index} {name}" if name else f"state {index}"


def has_states(specification: Mapping[str, Any]) -> bool:
    """Whether a controller is a state machine that is known and not too large to be drawn."""
    return colored_states(specification) > 0


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
