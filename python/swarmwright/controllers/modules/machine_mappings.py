"""Machines and trees of modules as the mappings that files hold: made, and read with every check."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmwright.common.problems import FieldError
from swarmwright.common.yaml import Path_
from swarmwright.controllers.modules.grammar import BUILT_IN, Catalogue, Module, Range, State, Transition


def states_from(
    machine: Any,  # noqa: ANN401 - a file's
    most_states: int,
    most_transitions: int,
    catalogue: Catalogue = BUILT_IN,
) -> tuple[State, ...]:
    """Return the states of a machine as files hold it: the mapping that `mapping_of` returns.

    Raises FieldError with what is wrong, and where in the machine.
    """
    entries = _list(_keys(machine, (), {"states"}).get("states"), ("states",), 1, most_states)
    names: dict[Any, int] = {index: index for index in range(len(entries))}
    for index, entry in enumerate(entries):
        if isinstance(entry, Mapping) and isinstance(entry.get("name"), str):
            if entry["name"] in names:
                raise FieldError(("states", index, "name"), f"{entry['name']!r} is given twice")
            names[entry["name"]] = index
    return tuple(
        _state(entry, index, names, most_transitions, catalogue) for index, entry in enumerate(entries)
    )


def subtrees_from(tree: Any, most: int, catalogue: Catalogue = BUILT_IN) -> tuple[State, ...]:  # noqa: ANN401 - a file's
    """Return the subtrees of a tree as files hold it: the mapping that `tree_mapping_of` returns.

    Raises FieldError with what is wrong, and where in the tree.
    """
    entries = _list(_keys(tree, (), {"subtrees"}).get("subtrees"), ("subtrees",), 1, most)
    subtrees = []
    for index, entry in enumerate(entries):
        here: Path_ = ("subtrees", index)
        given = _keys(entry, here, None)
        condition = _name(given.get("condition"), (*here, "condition"), catalogue.conditions)
        behaviour = _name(given.get("behaviour"), (*here, "behaviour"), catalogue.behaviours)
        known = _keys(entry, here, {"condition", "behaviour", *condition.parameters, *behaviour.parameters})
        transition = Transition(0, condition.name, _values(known, condition, here))
        subtrees.append(State(behaviour.name, _values(known, behaviour, here), (transition,)))
    return tuple(subtrees)


def tree_mapping_of(subtrees: Sequence[State]) -> dict[str, Any]:
    """Return a tree as files hold it."""
    entries = []
    for subtree in subtrees:
        (transition,) = subtree.transitions
        entries.append(
            {
                "condition": transition.condition,
                **transition.parameters,
                "behaviour": subtree.behaviour,
                **subtree.parameters,
            }
        )
    return {"subtrees": entries}


def _other_states(names: Mapping[Any, int], own: int) -> str:
    """Say where a transition from this state may lead."""
    others = [str(name) for name, number in names.items() if number != own]
    if not others:
        return "but the machine has one state only; add the state that the transition leads to"
    return f"expected another state: {', '.join(others)}"


def _state(
    entry: Any,  # noqa: ANN401 - a file's
    own: int,
    names: Mapping[Any, int],
    most: int,
    catalogue: Catalogue,
) -> State:
    """Return a state; own: its number; names: the numbers of all states by their names and numbers."""
    where: Path_ = ("states", own)
    given = _keys(entry, where, None).get("behaviour")
    behaviour = _name(given, (*where, "behaviour"), catalogue.behaviours)
    known = _keys(entry, where, {"name", "behaviour", "transitions", *behaviour.parameters})
    parameters = _values(known, behaviour, where)
    parts = _list(known.get("transitions", []), (*where, "transitions"), 0, most)
    transitions = []
    for index, part in enumerate(parts):
        here = (*where, "transitions", index)
        named = _keys(part, here, None).get("condition")
        condition = _name(named, (*here, "condition"), catalogue.conditions)
        values = _keys(part, here, {"to", "condition", *condition.parameters})
        to = values.get("to")
        if not isinstance(to, int | str) or isinstance(to, bool) or to not in names:
            raise FieldError((*here, "to"), f"{to!r} found, {_other_states(names, own)}")
        transitions.append(Transition(names[to], condition.name, _values(values, condition, here)))
    return State(behaviour.name, parameters, tuple(transitions))


def _keys(value: Any, where: Path_, known: set[str] | None) -> Mapping[str, Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, Mapping):
        raise FieldError(where, f"{value!r} found, expected a mapping")
    unknown = [] if known is None else sorted(str(key) for key in value if key not in known)
    if unknown:
        names = ", ".join(sorted(known or ()))
        raise FieldError((*where, unknown[0]), f"is not known here; known are {names}")
    return value


def _list(value: Any, where: Path_, least: int, most: int) -> Sequence[Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, list | tuple) or not least <= len(value) <= most:
        found = f"{len(value)} entries" if isinstance(value, list | tuple) else repr(value)
        raise FieldError(where, f"{found} found, expected a list of {least} to {most} entries")
    return value


def _name(value: Any, where: Path_, modules: Sequence[Module]) -> Module:  # noqa: ANN401 - a file's
    for module in modules:
        if module.name == value:
            return module
    names = ", ".join(module.name for module in modules)
    raise FieldError(where, f"{value!r} found, expected one of {names}")


def _values(values: Mapping[str, Any], module: Module, where: Path_) -> dict[str, float]:
    return {name: _value(values, name, parameter, where) for name, parameter in module.parameters.items()}


def _value(values: Mapping[str, Any], name: str, limits: Range, where: Path_) -> float:
    low, high, whole = limits
    value = values.get(name)
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    if value is None or not number or not low <= value <= high:
        kind = "an integer" if whole else "a number"
        raise FieldError((*where, name), f"{value!r} found, expected {kind} from {low:g} to {high:g}")
    return value  # type: ignore[no-any-return] # checked


def mapping_of(states: Sequence[State]) -> dict[str, Any]:
    """Return a machine as files hold it."""
    return {
        "states": [
            {
                "behaviour": state.behaviour,
                **state.parameters,
                "transitions": [
                    {"to": transition.target, "condition": transition.condition, **transition.parameters}
                    for transition in state.transitions
                ],
            }
            for state in states
        ]
    }
