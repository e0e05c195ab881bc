"""Machines and trees of modules in readable form: states with behaviours, transitions with conditions.

A subtree of a tree is a state with one transition, of which the condition counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from swarmwright.core.errors import InputError

BEHAVIOURS = ("exploration", "stop", "phototaxis", "anti_phototaxis", "attraction", "repulsion")
"""In the order of their numbers."""
CONDITIONS = (
    "black_floor",
    "grey_floor",
    "white_floor",
    "neighbours",
    "few_neighbours",
    "fixed_probability",
)
"""In the order of their numbers."""
SENSORS, ACTUATORS = 9, 2
MOST_STATES, MOST_TRANSITIONS = 16, 4
MOST_SUBTREES = 4
OF_STATE, OF_TRANSITION = 4, 5
"""Weights of a state without its transitions, and of a transition."""

BEHAVIOUR_PARAMETERS: dict[str, str] = {"exploration": "rwm", "attraction": "alpha", "repulsion": "alpha"}
"""What a behaviour is set by; others by nothing."""
CONDITION_PARAMETERS: dict[str, tuple[str, ...]] = {
    name: ("xi", "eta") if "neighbours" in name else ("probability",) for name in CONDITIONS
}
"""What a condition is set by."""
RANGES: dict[str, tuple[float, float, bool]] = {
    "rwm": (1, 100, True),
    "alpha": (1, 5, True),
    "probability": (0, 1, False),
    "xi": (1, 10, True),
    "eta": (0, 20, False),
}
"""Lowest and highest value of each parameter, and whether it is an integer."""
_PLACES = {"rwm": 1, "alpha": 2, "probability": 2, "xi": 3, "eta": 4}
"""In the weights of a state or of a transition."""


@dataclass(frozen=True)
class Transition:
    """A transition. target: number of a state. parameters: those of its condition."""

    target: int
    condition: str
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class State:
    """A state. parameters: those of its behaviour."""

    behaviour: str
    parameters: Mapping[str, float]
    transitions: tuple[Transition, ...]


def is_tree(specification: Mapping[str, Any]) -> bool:
    """Return whether a controller of the kind `modules` is a behaviour tree."""
    return specification.get("form") == "tree"


def states_of(specification: Mapping[str, Any]) -> tuple[State, ...]:
    """Return the states of a controller of the kind `modules`, state 0 first; of a tree the subtrees."""
    tree = is_tree(specification)
    weights = [float(weight) for weight in specification["weights"]]
    most = int(specification["transitions"])
    width = OF_STATE + most * OF_TRANSITION
    count = _whole(weights[0], 1, int(specification["states"]))
    found = []
    for index in range(count):
        row = weights[1 + index * width :][:width]
        behaviour = BEHAVIOURS[_whole(row[0], 0, len(BEHAVIOURS) - 1)]
        names = [BEHAVIOUR_PARAMETERS[behaviour]] if behaviour in BEHAVIOUR_PARAMETERS else []
        transitions = tuple(
            _transition(row[OF_STATE + k * OF_TRANSITION :][:OF_TRANSITION], count)
            for k in range(1 if tree else _whole(row[3], 0, most))
        )
        if tree:
            transitions = (Transition(0, transitions[0].condition, transitions[0].parameters),)
        found.append(State(behaviour, _parameters(row, names), transitions))
    return tuple(found)


def _transition(row: Sequence[float], states: int) -> Transition:
    condition = CONDITIONS[_whole(row[1], 0, len(CONDITIONS) - 1)]
    target = _whole(row[0], 0, states - 1)
    return Transition(target, condition, _parameters(row, CONDITION_PARAMETERS[condition]))


def _parameters(row: Sequence[float], names: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name in names:
        low, high, whole = RANGES[name]
        value = min(max(row[_PLACES[name]], low), high)
        found[name] = int(value) if whole else value
    return found


def _whole(weight: float, low: int, high: int) -> int:
    return int(min(max(weight, low), high))


def weights_of(states: Sequence[State], most_states: int, most_transitions: int) -> list[float]:
    """Return the weights of a controller with these states; places that are not used are 0."""
    weights = [float(len(states))]
    for state in states:
        row = [float(BEHAVIOURS.index(state.behaviour)), 0.0, 0.0, float(len(state.transitions))]
        for name, value in state.parameters.items():
            row[_PLACES[name]] = float(value)
        for transition in state.transitions:
            part = [float(transition.target), float(CONDITIONS.index(transition.condition)), 0.0, 0.0, 0.0]
            for name, value in transition.parameters.items():
                part[_PLACES[name]] = float(value)
            row += part
        weights += row + [0.0] * (OF_STATE + most_transitions * OF_TRANSITION - len(row))
    return weights + [0.0] * ((most_states - len(states)) * (OF_STATE + most_transitions * OF_TRANSITION))


def states_from(machine: Any, most_states: int, most_transitions: int) -> tuple[State, ...]:  # noqa: ANN401 - a file's
    """Return the states of a machine as files hold it: the mapping that `mapping_of` returns.

    Raises InputError with what is wrong, and where in the machine.
    """
    entries = _list(_keys(machine, "machine", {"states"}).get("states"), "states", 1, most_states)
    names: dict[Any, int] = {index: index for index in range(len(entries))}
    for index, entry in enumerate(entries):
        if isinstance(entry, Mapping) and isinstance(entry.get("name"), str):
            if entry["name"] in names:
                raise InputError(f"states[{index}].name: {entry['name']!r} is given twice")
            names[entry["name"]] = index
    return tuple(
        _state(entry, f"states[{index}]", names, most_transitions) for index, entry in enumerate(entries)
    )


def subtrees_from(tree: Any, most: int) -> tuple[State, ...]:  # noqa: ANN401 - a file's
    """Return the subtrees of a tree as files hold it: the mapping that `tree_mapping_of` returns.

    Raises InputError with what is wrong, and where in the tree.
    """
    entries = _list(_keys(tree, "tree", {"subtrees"}).get("subtrees"), "subtrees", 1, most)
    found = []
    for index, entry in enumerate(entries):
        here = f"subtrees[{index}]"
        condition = _name(_keys(entry, here, None).get("condition"), f"{here}.condition", CONDITIONS)
        behaviour = _name(entry.get("behaviour"), f"{here}.behaviour", BEHAVIOURS)
        wanted = CONDITION_PARAMETERS[condition]
        needed = [BEHAVIOUR_PARAMETERS[behaviour]] if behaviour in BEHAVIOUR_PARAMETERS else []
        known = _keys(entry, here, {"condition", "behaviour", *wanted, *needed})
        transition = Transition(0, condition, {name: _value(known, name, here) for name in wanted})
        found.append(State(behaviour, {name: _value(known, name, here) for name in needed}, (transition,)))
    return tuple(found)


def tree_mapping_of(subtrees: Sequence[State]) -> dict[str, Any]:
    """Return a tree as files hold it."""
    entries = []
    for subtree in subtrees:
        (one,) = subtree.transitions
        entries.append(
            {
                "condition": one.condition,
                **one.parameters,
                "behaviour": subtree.behaviour,
                **subtree.parameters,
            }
        )
    return {"subtrees": entries}


def _state(
    entry: Any,  # noqa: ANN401 - a file's
    where: str,
    names: Mapping[Any, int],
    most: int,
) -> State:
    """Return a state; names: the numbers of all states by their names and numbers."""
    behaviour = _name(_keys(entry, where, None).get("behaviour"), f"{where}.behaviour", BEHAVIOURS)
    needed = [BEHAVIOUR_PARAMETERS[behaviour]] if behaviour in BEHAVIOUR_PARAMETERS else []
    known = _keys(entry, where, {"name", "behaviour", "transitions", *needed})
    parameters = {name: _value(known, name, where) for name in needed}
    parts = _list(known.get("transitions", []), f"{where}.transitions", 0, most)
    transitions = []
    for index, part in enumerate(parts):
        here = f"{where}.transitions[{index}]"
        condition = _name(_keys(part, here, None).get("condition"), f"{here}.condition", CONDITIONS)
        wanted = CONDITION_PARAMETERS[condition]
        values = _keys(part, here, {"to", "condition", *wanted})
        to = values.get("to")
        if not isinstance(to, int | str) or isinstance(to, bool) or to not in names:
            shown = ", ".join(map(str, names))
            raise InputError(f"{here}.to: {to!r} found, expected one of the states {shown}")
        chosen = {name: _value(values, name, here) for name in wanted}
        transitions.append(Transition(names[to], condition, chosen))
    return State(behaviour, parameters, tuple(transitions))


def _keys(value: Any, where: str, known: set[str] | None) -> Mapping[str, Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: {value!r} found, expected a mapping")
    unknown = [] if known is None else sorted(str(key) for key in value if key not in known)
    if unknown:
        names = ", ".join(sorted(known or ()))
        raise InputError(f"{where}.{unknown[0]}: is not known here; known are {names}")
    return value


def _list(value: Any, where: str, least: int, most: int) -> Sequence[Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, list | tuple) or not least <= len(value) <= most:
        found = f"{len(value)} entries" if isinstance(value, list | tuple) else repr(value)
        raise InputError(f"{where}: {found} found, expected a list of {least} to {most} entries")
    return value


def _name(value: Any, where: str, names: Sequence[str]) -> str:  # noqa: ANN401 - a file's
    if value not in names:
        raise InputError(f"{where}: {value!r} found, expected one of {', '.join(names)}")
    return str(value)


def _value(values: Mapping[str, Any], name: str, where: str) -> float:
    low, high, whole = RANGES[name]
    value = values.get(name)
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    if value is None or not number or not low <= value <= high:
        kind = "an integer" if whole else "a number"
        raise InputError(f"{where}.{name}: {value!r} found, expected {kind} from {low:g} to {high:g}")
    return value  # type: ignore[no-any-return] # checked


def mapping_of(states: Sequence[State]) -> dict[str, Any]:
    """Return a machine as files hold it."""
    return {
        "states": [
            {
                "behaviour": state.behaviour,
                **state.parameters,
                "transitions": [
                    {"to": one.target, "condition": one.condition, **one.parameters}
                    for one in state.transitions
                ],
            }
            for state in states
        ]
    }


def _words(name: str, parameters: Mapping[str, float]) -> str:
    values = ", ".join(f"{key} {value:.4g}" for key, value in parameters.items())
    return name.replace("_", " ") + (f" ({values})" if values else "")


def words_of(part: State | Transition) -> str:
    """Return a state's behaviour or a transition's condition in words, with its parameters."""
    if isinstance(part, State):
        return _words(part.behaviour, part.parameters)
    return f"to state {part.target}: {_words(part.condition, part.parameters)}"


def as_text(states: Sequence[State]) -> str:
    """Return a machine in words, a line for each state and transition."""
    lines = []
    for index, state in enumerate(states):
        lines.append(f"state {index}: {words_of(state)}")
        lines += [f"  {words_of(one)}" for one in state.transitions]
    return "\n".join(lines)


def as_diagram(states: Sequence[State], language: Literal["dot", "mermaid"]) -> str:
    """Return a machine as text of Graphviz (`dot`) or of Mermaid."""
    labels = [_words(state.behaviour, state.parameters) for state in states]
    edges = [
        (index, one.target, _words(one.condition, one.parameters))
        for index, state in enumerate(states)
        for one in state.transitions
    ]
    if language == "mermaid":
        lines = ["stateDiagram-v2", "    [*] --> s0"]
        lines += [f'    state "{label}" as s{index}' for index, label in enumerate(labels)]
        lines += [f"    s{source} --> s{target}: {label}" for source, target, label in edges]
        return "\n".join(lines)
    lines = ["digraph machine {", "    rankdir=LR; node [shape=ellipse]; s0 [peripheries=2];"]
    lines += [f'    s{index} [label="{label}"];' for index, label in enumerate(labels)]
    lines += [f'    s{source} -> s{target} [label="{label}"];' for source, target, label in edges]
    return "\n".join([*lines, "}"])


def condition_words(subtree: State) -> str:
    """Return the condition of a subtree in words, with its parameters."""
    (one,) = subtree.transitions
    return _words(one.condition, one.parameters)


def tree_text(subtrees: Sequence[State]) -> str:
    """Return a tree in words, two lines for each subtree."""
    lines = ["sequence with memory, goes on where it was:"]
    for index, subtree in enumerate(subtrees):
        lines.append(f"  subtree {index}: next one if {condition_words(subtree)}")
        lines.append(f"    else {words_of(subtree)}")
    return "\n".join(lines)


def tree_diagram(subtrees: Sequence[State], language: Literal["dot", "mermaid"]) -> str:
    """Return a tree as text of Graphviz (`dot`) or of Mermaid."""
    leaves = [(condition_words(one), words_of(one)) for one in subtrees]
    if language == "mermaid":
        lines = ["flowchart TD", '    root["sequence*"]']
        for index, (condition, action) in enumerate(leaves):
            lines.append(f'    root --> s{index}["?"]')
            lines.append(f'    s{index} --> c{index}(["{condition}"])')
            lines.append(f'    s{index} --> a{index}["{action}"]')
        return "\n".join(lines)
    lines = ["digraph tree {", "    node [shape=box]; ordering=out;", '    root [label="sequence*"];']
    for index, (condition, action) in enumerate(leaves):
        lines.append(f'    s{index} [label="?"]; root -> s{index};')
        lines.append(f'    c{index} [label="{condition}", shape=ellipse]; s{index} -> c{index};')
        lines.append(f'    a{index} [label="{action}"]; s{index} -> a{index};')
    return "\n".join([*lines, "}"])


def controller_text(specification: Mapping[str, Any]) -> str:
    """Return a controller of the kind `modules` in words."""
    states = states_of(specification)
    return tree_text(states) if is_tree(specification) else as_text(states)


def controller_diagram(specification: Mapping[str, Any], language: Literal["dot", "mermaid"]) -> str:
    """Return a controller of the kind `modules` as text of Graphviz (`dot`) or of Mermaid."""
    states = states_of(specification)
    return tree_diagram(states, language) if is_tree(specification) else as_diagram(states, language)
