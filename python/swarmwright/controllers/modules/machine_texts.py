"""Machines and trees of modules as text and as diagrams for Graphviz and Mermaid."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from swarmwright.controllers.modules.grammar import State, Transition, is_tree, states_of


def _words(name: str, parameters: Mapping[str, float]) -> str:
    values = ", ".join(f"{key} {value:.4g}" for key, value in parameters.items())
    return name + (f" ({values})" if values else "")


def name_of(behaviour: str) -> str:
    """Return the name of a behaviour in drawings and texts, such as anti-phototaxis."""
    return behaviour.replace("_", "-")


def _behaviour_words(state: State) -> str:
    return _words(name_of(state.behaviour), state.parameters)


def _condition_words(transition: Transition) -> str:
    return _words(transition.condition.replace("_", " "), transition.parameters)


def words_of(part: State | Transition) -> str:
    """Return a state's behaviour or a transition's condition in words, with its parameters."""
    if isinstance(part, State):
        return _behaviour_words(part)
    return f"to state {part.target}: {_condition_words(part)}"


def as_text(states: Sequence[State]) -> str:
    """Return a machine in words, a line for each state and transition."""
    lines = []
    for index, state in enumerate(states):
        lines.append(f"state {index}: {words_of(state)}")
        lines += [f"  {words_of(transition)}" for transition in state.transitions]
    return "\n".join(lines)


def as_diagram(states: Sequence[State], language: Literal["dot", "mermaid"]) -> str:
    """Return a machine as text of Graphviz (`dot`) or of Mermaid."""
    labels = [_behaviour_words(state) for state in states]
    edges = [
        (index, transition.target, _condition_words(transition))
        for index, state in enumerate(states)
        for transition in state.transitions
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
    (transition,) = subtree.transitions
    return _condition_words(transition)


def tree_text(subtrees: Sequence[State]) -> str:
    """Return a tree in words, two lines for each subtree."""
    lines = ["sequence with memory, goes on where it was:"]
    for index, subtree in enumerate(subtrees):
        lines.append(f"  subtree {index}: next subtree if {condition_words(subtree)}")
        lines.append(f"    else {words_of(subtree)}")
    return "\n".join(lines)


def tree_diagram(subtrees: Sequence[State], language: Literal["dot", "mermaid"]) -> str:
    """Return a tree as text of Graphviz (`dot`) or of Mermaid."""
    leaves = [(condition_words(subtree), words_of(subtree)) for subtree in subtrees]
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
