"""Behaviour trees of modules as a representation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.yaml import dump
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions
from swarmwright.controllers.modules import grammar, machine_mappings
from swarmwright.testing import check_representation
from tests.python.controllers.machines import AUTOMODE, TREE, machines


def test_trees_are_a_form_of_it() -> None:
    check_representation("modules", {"form": "tree"})
    check_representation("modules", {"form": "tree", "states": 1})
    check_representation("modules", {"form": "tree", "states": 3, "transitions": 1})
    check_representation("modules", {"form": "tree", "machine": TREE})
    options = ModulesOptions(form="tree")
    assert ModulesOptions.model_validate(options.model_dump()) == options, "as a run stores it"


def test_random_trees_have_every_module_and_a_condition_each() -> None:
    subject = machines(form="tree")
    assert subject.genome_size == 37
    assert subject.architecture()["form"] == "tree"
    found = [subject.states(genome) for genome in subject.initials(Streams(1, "x", 0, range(2000)))]
    counts = np.bincount([len(states) for states in found], minlength=5)[1:]
    assert (np.abs(counts - 500) < 100).all()
    subtrees = [one for states in found for one in states]
    assert {len(one.transitions) for one in subtrees} == {1}
    for name in grammar.BEHAVIOURS:
        assert 0.13 < sum(one.behaviour == name for one in subtrees) / len(subtrees) < 0.21
    for name in grammar.CONDITIONS:
        share = sum(one.transitions[0].condition == name for one in subtrees) / len(subtrees)
        assert 0.13 < share < 0.21


@given(seed=st.integers(0, 2**60), severity=st.floats(0, 3))
def test_a_change_changes_one_part_of_a_tree(seed: int, severity: float) -> None:
    subject = machines(form="tree")
    genome = subject.initial(Stream(seed, "initial"))
    changed = genome.astype(np.float64)
    subject._changes.make(changed[np.newaxis], [Stream(seed, "change")], np.array([severity]))
    assert (changed != genome).sum() <= 1
    one, other = subject.states(genome), subject.states(changed.astype(np.float32))
    assert abs(len(one) - len(other)) <= 1
    if len(one) == len(other):
        assert sum(a != b for a, b in zip(one, other, strict=True)) <= 1


def test_changes_reach_every_part_of_a_tree() -> None:
    subject = machines(form="tree", machine=TREE)
    assert subject.start is not None
    parents = np.repeat(subject.start[np.newaxis], 600, axis=0)
    mutants = subject.mutations(parents, Streams(1, "m", 0, range(600)), severity=0.0, probability=1.0)
    places = set(np.flatnonzero((mutants != subject.start).any(axis=0)).tolist())
    # Number, then: behaviour, rwm, alpha, count, target, condition, probability, xi, eta. The severity is 0:
    # what is counted moves by 1, and probability and eta do not move.
    assert places == {0, 1, 2, 6, 10, 12, 15, 17, 19, 24}


def test_a_given_tree_is_where_evolution_starts(tmp_path: Path) -> None:
    file = tmp_path / "tree.yaml"
    file.write_text(dump(TREE))
    subject = machines(form="tree", machine=str(file))
    expected = machine_mappings.parse_subtrees(TREE, 4)
    assert machine_mappings.tree_mapping_of(expected) == TREE
    assert subject.start is not None
    assert subject.states(subject.start) == expected
    genomes = subject.initials(Streams(1, "x", 0, range(60)))
    assert 2 <= sum(subject.states(genome) == expected for genome in genomes) <= 30


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"states": 5}, "states: a tree has at most 4 subtrees, not 5"),
        ({"transitions": 2}, "transitions: a subtree has one condition; remove this key"),
        ({"machine": {"states": []}}, "machine.states: unknown key; expected one of subtrees"),
        ({"machine": {"subtrees": []}}, "machine.subtrees: 0 entries found, expected a list of 1 to 4 ent"),
        ({"machine": {"subtrees": [{}]}}, "subtrees[0].condition: None found, expected one of black_floor"),
        (
            {"machine": {"subtrees": [{"condition": "grey_floor", "behaviour": "stop"}]}},
            "subtrees[0].probability: None found, expected a number from 0 to 1",
        ),
        (
            {
                "machine": {
                    "subtrees": [{"condition": "grey_floor", "probability": 1, "behaviour": "stop", "rwm": 3}]
                }
            },
            "subtrees[0].rwm: unknown key",
        ),
        ({"machine": AUTOMODE}, "AutoMoDe's --fsm-config describes a machine; leave out form: tree"),
    ],
)
def test_what_is_wrong_with_a_tree_is_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        ModulesOptions.model_validate({"form": "tree", **options})
    assert words in str(caught.value)


def genome_of(subject: Modules, rows: list[list[float]]) -> np.ndarray[Any, np.dtype[np.float32]]:
    genome = np.zeros(subject.genome_size, np.float32)
    values = [len(rows) + 0.5, *(value for row in rows for value in row)]
    genome[: len(values)] = values
    return genome


def test_likeness_looks_at_what_is_used_only() -> None:
    subject = machines(form="tree")
    stop, explore, fixed, few = 1.5, 0.5, 5.5, 4.5
    one = genome_of(subject, [[stop, 9, 2, 0, 0, fixed, 0.5, 3, 7], [explore, 20, 2, 0, 0, few, 0.5, 3.2, 7]])
    other = genome_of(
        subject, [[stop, 50, 4, 1, 1, fixed, 0.5, 8, 1], [explore, 20, 5, 1, 2, few, 0.9, 3.9, 7]]
    )
    rows = subject.likeness(np.stack([one, other]))
    assert (rows[0] == rows[1]).all()
    for place, value in ((0, 1.5), (1, 0.5), (6, 4.5), (7, 0.6), (11, 21), (17, 4), (18, 8)):
        changed = one.copy()
        changed[place] = value
        assert (subject.likeness(np.stack([one, changed]))[1] != rows[0]).any(), place
