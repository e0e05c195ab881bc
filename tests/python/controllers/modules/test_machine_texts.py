"""Machines and trees of modules in words and as diagrams."""

from swarmwright.controllers.modules import machine_mappings, machine_texts
from tests.python.controllers.machines import MACHINE, TREE


def test_machines_can_be_read() -> None:
    states = machine_mappings.parse_states(MACHINE, 4, 4)
    assert machine_texts.as_text(states) == (
        "state 0: exploration (rwm 7)\n"
        "  to state 1: black floor (probability 0.75)\n"
        "  to state 2: few neighbours (xi 3, eta 1.5)\n"
        "state 1: stop\n"
        "  to state 0: fixed probability (probability 0.125)\n"
        "state 2: attraction (alpha 4)"
    )
    dot = machine_texts.as_diagram(states, "dot")
    assert dot.startswith("digraph machine {")
    assert 's0 -> s1 [label="black floor (probability 0.75)"];' in dot
    mermaid = machine_texts.as_diagram(states, "mermaid")
    assert mermaid.startswith("stateDiagram-v2\n    [*] --> s0")
    assert "    s1 --> s0: fixed probability (probability 0.125)" in mermaid


def test_trees_can_be_read() -> None:
    subtrees = machine_mappings.parse_subtrees(TREE, 4)
    assert machine_texts.tree_text(subtrees) == (
        "sequence with memory, goes on where it was:\n"
        "  subtree 0: next subtree if black floor (probability 0.75)\n"
        "    else exploration (rwm 7)\n"
        "  subtree 1: next subtree if few neighbours (xi 3, eta 1.5)\n"
        "    else attraction (alpha 4)\n"
        "  subtree 2: next subtree if fixed probability (probability 0.125)\n"
        "    else stop"
    )
    dot = machine_texts.tree_diagram(subtrees, "dot")
    assert dot.startswith("digraph tree {")
    assert 'c1 [label="few neighbours (xi 3, eta 1.5)", shape=ellipse]; s1 -> c1;' in dot
    mermaid = machine_texts.tree_diagram(subtrees, "mermaid")
    assert mermaid.startswith('flowchart TD\n    root["sequence*"]')
    assert '    s2 --> a2["stop"]' in mermaid
