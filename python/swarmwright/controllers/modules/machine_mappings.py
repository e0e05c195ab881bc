"""Conversion between machines or trees of modules and the mappings in files."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmwright.common.problems import FieldError
from swarmwright.common.yaml import Path_
from swarmwright.controllers.modules.grammar import BUILT_IN, Catalogue, Module, Range, State, Transition


def parse_states(
    machine: Any,  # noqa: ANN401 - a file's
    most_states: int,
    most_transitions: int,
    catalogue: Catalogue = BUILT_IN,
) -> tuple[State, ...]:
    """Parse the states of a machine in the form that `machine_mapping_of` returns.

    Raises FieldError with the key of the first problem.
    """
    entries = _check_list(_check_keys(machine, (), {"states"}).get("states"), ("states",), 1, most_states)
    names: dict[Any, int] = {index: index for index in range(len(entries))}
    for index, entry in enumerate(entries):
        if isinstance(entry, Mapping) and isinstance(entry.get("name"), str):
            if entry["name"] in names:
                raise FieldError(("states", index, "name"), f"{entry['name']!r} occurs twice")
            names[entry["name"]] = index
    return tuple(
        _parse_state(entry, index, names, most_transitions, catalogue) for index, entry in enumerate(entries)
    )


def parse_subtrees(tree: Any, most: int, catalogue: Catalogue = BUILT_IN) -> tuple[State, ...]:  # noqa: ANN401 - a file's
    """Parse the subtrees of a tree in the form that `tree_mapping_of` returns.

    Raises FieldError with the key of the first problem.
    """
    entries = _check_list(_check_keys(tree, (), {"subtrees"}).get("subtrees"), ("subtrees",), 1, most)
    subtrees = []
    for index, entry in enumerate(entries):
        path: Path_ = ("subtrees", index)
        keys = _check_keys(entry, path, None)
        condition = _find_module(keys.get("condition"), (*path, "condition"), catalogue.conditions)
        behaviour = _find_module(keys.get("behaviour"), (*path, "behaviour"), catalogue.behaviours)
        values = _check_keys(
            entry, path, {"condition", "behaviour", *condition.parameters, *behaviour.parameters}
        )
        transition = Transition(0, condition.name, _parse_values(values, condition, path))
        subtrees.append(State(behaviour.name, _parse_values(values, behaviour, path), (transition,)))
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


def _suggest_targets(names: Mapping[Any, int], state: int) -> str:
    """Name the states to which a transition may lead."""
    other_names = [str(name) for name, number in names.items() if number != state]
    if not other_names:
        return "but the machine has a single state; add the target state"
    return f"expected another state: {', '.join(other_names)}"


def _parse_state(
    entry: Any,  # noqa: ANN401 - a file's
    number: int,
    names: Mapping[Any, int],
    most: int,
    catalogue: Catalogue,
) -> State:
    """Parse a state; own: its number; names: the numbers of all states by name and number."""
    path: Path_ = ("states", number)
    behaviour_name = _check_keys(entry, path, None).get("behaviour")
    behaviour = _find_module(behaviour_name, (*path, "behaviour"), catalogue.behaviours)
    state_values = _check_keys(entry, path, {"name", "behaviour", "transitions", *behaviour.parameters})
    parameters = _parse_values(state_values, behaviour, path)
    parts = _check_list(state_values.get("transitions", []), (*path, "transitions"), 0, most)
    transitions = []
    for index, part in enumerate(parts):
        transition_path = (*path, "transitions", index)
        named = _check_keys(part, transition_path, None).get("condition")
        condition = _find_module(named, (*transition_path, "condition"), catalogue.conditions)
        values = _check_keys(part, transition_path, {"to", "condition", *condition.parameters})
        to = values.get("to")
        if not isinstance(to, int | str) or isinstance(to, bool) or to not in names:
            raise FieldError((*transition_path, "to"), f"{to!r} found, {_suggest_targets(names, number)}")
        transitions.append(
            Transition(names[to], condition.name, _parse_values(values, condition, transition_path))
        )
    return State(behaviour.name, parameters, tuple(transitions))


def _check_keys(value: Any, path: Path_, allowed: set[str] | None) -> Mapping[str, Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, Mapping):
        raise FieldError(path, f"{value!r} found, expected a mapping")
    unknown = [] if allowed is None else sorted(str(key) for key in value if key not in allowed)
    if unknown:
        names = ", ".join(sorted(allowed or ()))
        raise FieldError((*path, unknown[0]), f"unknown key; expected one of {names}")
    return value


def _check_list(value: Any, path: Path_, least: int, most: int) -> Sequence[Any]:  # noqa: ANN401 - a file's
    if not isinstance(value, list | tuple) or not least <= len(value) <= most:
        content = f"{len(value)} entries" if isinstance(value, list | tuple) else repr(value)
        raise FieldError(path, f"{content} found, expected a list of {least} to {most} entries")
    return value


def _find_module(value: Any, path: Path_, modules: Sequence[Module]) -> Module:  # noqa: ANN401 - a file's
    for module in modules:
        if module.name == value:
            return module
    names = ", ".join(module.name for module in modules)
    raise FieldError(path, f"{value!r} found, expected one of {names}")


def _parse_values(values: Mapping[str, Any], module: Module, path: Path_) -> dict[str, float]:
    return {
        name: _parse_value(values, name, parameter, path) for name, parameter in module.parameters.items()
    }


def _parse_value(values: Mapping[str, Any], name: str, limits: Range, path: Path_) -> float:
    low, high, whole = limits
    value = values.get(name)
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    if value is None or not number or not low <= value <= high:
        kind = "an integer" if whole else "a number"
        raise FieldError((*path, name), f"{value!r} found, expected {kind} from {low:g} to {high:g}")
    return value  # type: ignore[no-any-return] # checked


def machine_mapping_of(states: Sequence[State]) -> dict[str, Any]:
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
