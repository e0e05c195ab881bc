"""Machines of modules as a representation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmwright import Experiment, InputError
from swarmwright.core import modules
from swarmwright.core.automode import machine_of, text_of, tree_of
from swarmwright.core.random_numbers import Stream, Streams
from swarmwright.core.yaml import dump
from swarmwright.representations.modules import Modules, ModulesOptions
from swarmwright.testing import check_representation

MACHINE: dict[str, Any] = {
    "states": [
        {
            "name": "walk",
            "behaviour": "exploration",
            "rwm": 7,
            "transitions": [
                {"to": "stay", "condition": "black_floor", "probability": 0.75},
                {"to": 2, "condition": "few_neighbours", "xi": 3, "eta": 1.5},
            ],
        },
        {
            "name": "stay",
            "behaviour": "stop",
            "transitions": [{"to": "walk", "condition": "fixed_probability", "probability": 0.125}],
        },
        {"behaviour": "attraction", "alpha": 4},
    ]
}


def machines(**options: Any) -> Modules:
    return Modules(ModulesOptions(**options), sensors=9, actuators=2)


def test_it_is_a_representation() -> None:
    check_representation("modules")
    check_representation("modules", {"states": 1})
    check_representation("modules", {"states": 6, "transitions": 1})
    check_representation("modules", {"states": 1, "transitions": 1})


def test_random_machines_have_every_module_and_every_target() -> None:
    subject = machines()
    assert subject.genome_size == 97
    genomes = subject.initials(Streams(1, "x", 0, range(2000)))
    found = [subject.states(genome) for genome in genomes]
    counts = np.bincount([len(states) for states in found], minlength=5)[1:]
    assert (np.abs(counts - 500) < 100).all()
    of_four = [states for states in found if len(states) == 4]
    behaviours = [state.behaviour for states in of_four for state in states]
    transitions = [(i, one) for states in of_four for i, s in enumerate(states) for one in s.transitions]
    for name in modules.BEHAVIOURS:
        assert 0.12 < behaviours.count(name) / len(behaviours) < 0.22
    for name in modules.CONDITIONS:
        share = sum(one.condition == name for _, one in transitions) / len(transitions)
        assert 0.12 < share < 0.22
    assert all(one.target != source for source, one in transitions)
    targets = np.bincount([one.target for source, one in transitions if source == 3], minlength=4)
    assert (np.abs(targets[:3] / targets.sum() - 1 / 3) < 0.06).all()
    assert {len(s.transitions) for states in of_four for s in states} == {1, 2, 3, 4}
    assert {len(s.transitions) for states in found if len(states) == 1 for s in states} == {0}
    for states in of_four:
        for name, (low, high, whole) in modules.RANGES.items():
            values = [s.parameters[name] for s in states if name in s.parameters]
            assert all(low <= value <= high and (not whole or value == int(value)) for value in values)


@given(seed=st.integers(0, 2**60), severity=st.floats(0, 3))
def test_a_change_changes_one_part_of_a_machine(seed: int, severity: float) -> None:
    subject = machines()
    genome = subject.initial(Stream(seed, "initial"))
    changed = genome.astype(np.float64)
    subject._changes.make(changed[np.newaxis], [Stream(seed, "change")], np.array([severity]))
    assert (changed != genome).sum() <= 1
    lower, upper = subject.bounds
    assert ((lower <= changed) & (changed <= upper)).all()
    one, other = subject.states(genome), subject.states(changed.astype(np.float32))
    if len(one) == len(other):
        pairs = zip(one, other, strict=True)
        different = [(a, b) for a, b in pairs if a != b]
        assert len(different) <= 1
    else:
        assert abs(len(one) - len(other)) == 1


def test_mutations_are_small_and_reach_everything() -> None:
    subject = machines()
    genome = subject.initial(Stream(3, "initial"))
    streams = Streams(1, "mutate", 0, range(400))
    parents = np.repeat(genome[np.newaxis], 400, axis=0)
    mutants = subject.mutations(parents, streams, severity=0.3, probability=1.0)
    changes = (mutants != genome).sum(axis=1)
    assert 1.0 < changes.mean() < 1.8
    assert changes.max() <= 8
    assert len({str(subject.states(mutant)) for mutant in mutants}) > 40


def test_a_given_machine_is_where_evolution_starts() -> None:
    subject = machines(machine=MACHINE)
    genomes = subject.initials(Streams(1, "x", 0, range(60)))
    expected = modules.states_from(MACHINE, 4, 4)
    found = [subject.states(genome) == expected for genome in genomes]
    assert 2 <= sum(found) <= 30
    again = modules.states_from(modules.mapping_of(expected), 4, 4)
    assert again == expected
    weights = modules.weights_of(expected, 4, 4)
    assert modules.states_of({**subject.architecture(), "weights": weights}) == expected
    check_representation("modules", {"machine": MACHINE})


def test_a_machine_may_be_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(dump(MACHINE))
    options = ModulesOptions(machine=str(file))
    assert options.machine == MACHINE
    file.unlink()
    with pytest.raises(ValidationError, match=r"machine\.yaml") as caught:
        ModulesOptions(machine=str(file))
    assert "expected a mapping, such a file, or AutoMoDe's --nstates" in str(caught.value)


def test_a_mistake_in_a_machine_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    for text, problem in (
        ("states:\n  - behaviour: exploration\n    rwm: 900\n", ":3: states[0].rwm: 900 found"),
        ("states:\n  - {behaviour: stop}\nstart: 0\n", ":3: start: is not known here"),
        ("--nstates 2 --s0 99\n", ":1: --s0: expected an integer from 0 to 5"),
    ):
        file.write_text(text)
        with pytest.raises(ValidationError) as caught:
            ModulesOptions(machine=str(file))
        assert f"machine: {file}{problem}" in str(caught.value)


def test_machines_can_be_read() -> None:
    states = modules.states_from(MACHINE, 4, 4)
    assert modules.as_text(states) == (
        "state 0: exploration (rwm 7)\n"
        "  to state 1: black floor (probability 0.75)\n"
        "  to state 2: few neighbours (xi 3, eta 1.5)\n"
        "state 1: stop\n"
        "  to state 0: fixed probability (probability 0.125)\n"
        "state 2: attraction (alpha 4)"
    )
    dot = modules.as_diagram(states, "dot")
    assert dot.startswith("digraph machine {")
    assert 's0 -> s1 [label="black floor (probability 0.75)"];' in dot
    mermaid = modules.as_diagram(states, "mermaid")
    assert mermaid.startswith("stateDiagram-v2\n    [*] --> s0")
    assert "    s1 --> s0: fixed probability (probability 0.125)" in mermaid


def changed(*path: Any, value: Any) -> dict[str, Any]:
    """The machine with another value somewhere; None removes it."""
    import copy

    machine = copy.deepcopy(MACHINE)
    part: Any = machine
    for key in path[:-1]:
        part = part[key]
    if value is None:
        del part[path[-1]]
    else:
        part[path[-1]] = value
    return machine


@pytest.mark.parametrize(
    ("machine", "words"),
    [
        (changed("states", value=[]), "machine: states: 0 entries found, expected a list of 1 to 4 entries"),
        (changed("colour", value="red"), "machine: machine.colour: is not known here; known are states"),
        (changed("states", 0, "behaviour", value="fly"), "states[0].behaviour: 'fly' found, expected one of"),
        (
            changed("states", 0, "rwm", value=None),
            "states[0].rwm: None found, expected an integer from 1 to 100",
        ),
        (changed("states", 0, "rwm", value=7.5), "states[0].rwm: 7.5 found"),
        (changed("states", 1, "rwm", value=7), "states[1].rwm: is not known here"),
        (changed("states", 1, "name", value="walk"), "states[1].name: 'walk' is given twice"),
        (
            changed("states", 0, "transitions", 0, "to", value="walk"),
            "states[0].transitions[0].to: a transition must lead to another state",
        ),
        (
            changed("states", 0, "transitions", 0, "to", value=7),
            "transitions[0].to: 7 found, expected another state: 1, 2, stay",
        ),
        (
            changed("states", 0, "transitions", 0, "probability", value=1.5),
            "states[0].transitions[0].probability: 1.5 found, expected a number from 0 to 1",
        ),
        (changed("states", 0, "transitions", 1, "xi", value=True), "transitions[1].xi: True found"),
        (changed("states", 2, value=[]), "states[2]: [] found, expected a mapping"),
    ],
)
def test_what_is_wrong_with_a_machine_is_named(machine: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        ModulesOptions(machine=machine)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "machine.yaml: is empty"),
        (
            "states:\n  - behaviour: stop\n    behaviour: attraction\n",
            "machine.yaml:3: duplicate key",
        ),
        ("states: [\n", "machine.yaml:2: "),
    ],
)
def test_what_is_wrong_with_the_file_of_a_machine_is_named(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(text)
    with pytest.raises(ValidationError) as caught:
        ModulesOptions(machine=str(file))
    assert words in str(caught.value)


AUTOMODE = (
    "--nstates 4 --s0 2 --n0 3 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 2 --p0x1 0.4 --n0x2 2 --c0x2 5 "
    "--p0x2 0.02 --s1 1 --n1 2 --n1x0 0 --c1x0 4 --p1x0 2 --w1x0 3.5 --n1x1 2 --c1x1 1 --p1x1 0.6 --s2 0 "
    "--rwm2 20.9 --n2 2 --n2x0 0 --c2x0 1 --p2x0 0.05 --n2x1 9 --c2x1 3 --p2x1 1 --w2x1 8 --s3 5 --rep3 3.7"
)


def test_machines_in_automodes_form() -> None:
    states = modules.states_from(machine_of(AUTOMODE), 4, 4)
    assert modules.as_text(states) == (
        "state 0: phototaxis\n"
        "  to state 1: black floor (probability 0.5)\n"
        "  to state 2: white floor (probability 0.4)\n"
        "  to state 3: fixed probability (probability 0.02)\n"
        "state 1: stop\n"
        "  to state 0: few neighbours (xi 2, eta 3.5)\n"
        "  to state 3: grey floor (probability 0.6)\n"
        "state 2: exploration (rwm 20)\n"
        "  to state 0: grey floor (probability 0.05)\n"
        "state 3: repulsion (alpha 3)"
    )
    subject = machines(machine=AUTOMODE)
    assert any(subject.states(genome) == states for genome in subject.initials(Streams(1, "x", 0, range(40))))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("--nstates 2 --s0", "expected pairs such as"),
        ("nstates 2", "expected a mapping, such a file, or AutoMoDe's --nstates"),
        ("--nstates 1 --s0 1 --s0 1", "a parameter is given twice"),
        ("--nstates 0", "states: 0 entries found"),
        ("--nstates 1 --s0 6", "--s0: expected an integer from 0 to 5, and found 6"),
        ("--nstates 1 --s0 0", "--rwm0: is missing; expected a number"),
        ("--nstates 1 --s0 x", "--s0: 'x' found, expected a number"),
        ("--nstates 1 --s0 1 --s1 1", "--s1: is not a part of this machine"),
        ("--nstates 2 --s0 1 --s1 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 2", "probability: 2.0 found"),
        ("--bt-config --nroot 3 --nchildroot 1", "AutoMoDe's --bt-config describes a tree; set form: tree"),
    ],
)
def test_what_is_wrong_in_automodes_form_is_named(text: str, words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        ModulesOptions(machine=text)
    assert words in str(caught.value)


def test_other_sensors_are_refused_with_what_is_needed() -> None:
    with pytest.raises(InputError, match=r"modules needs 9 sensors .* but the simulation has 4 and 1"):
        Modules(ModulesOptions(), sensors=4, actuators=1)
    experiment = Experiment.from_mapping({"simulation": "elsewhere", "controller": {"kind": "modules"}})
    with pytest.raises(InputError, match=r"take a robot such as e-puck-rm1\.2"):
        experiment.representation(4, 1)


TREE: dict[str, Any] = {
    "subtrees": [
        {"condition": "black_floor", "probability": 0.75, "behaviour": "exploration", "rwm": 7},
        {"condition": "few_neighbours", "xi": 3, "eta": 1.5, "behaviour": "attraction", "alpha": 4},
        {"condition": "fixed_probability", "probability": 0.125, "behaviour": "stop"},
    ]
}


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
    for name in modules.BEHAVIOURS:
        assert 0.13 < sum(one.behaviour == name for one in subtrees) / len(subtrees) < 0.21
    for name in modules.CONDITIONS:
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
    expected = modules.subtrees_from(TREE, 4)
    assert modules.tree_mapping_of(expected) == TREE
    assert subject.start is not None
    assert subject.states(subject.start) == expected
    genomes = subject.initials(Streams(1, "x", 0, range(60)))
    assert 2 <= sum(subject.states(genome) == expected for genome in genomes) <= 30


def test_trees_can_be_read() -> None:
    subtrees = modules.subtrees_from(TREE, 4)
    assert modules.tree_text(subtrees) == (
        "sequence with memory, goes on where it was:\n"
        "  subtree 0: next one if black floor (probability 0.75)\n"
        "    else exploration (rwm 7)\n"
        "  subtree 1: next one if few neighbours (xi 3, eta 1.5)\n"
        "    else attraction (alpha 4)\n"
        "  subtree 2: next one if fixed probability (probability 0.125)\n"
        "    else stop"
    )
    dot = modules.tree_diagram(subtrees, "dot")
    assert dot.startswith("digraph tree {")
    assert 'c1 [label="few neighbours (xi 3, eta 1.5)", shape=ellipse]; s1 -> c1;' in dot
    mermaid = modules.tree_diagram(subtrees, "mermaid")
    assert mermaid.startswith('flowchart TD\n    root["sequence*"]')
    assert '    s2 --> a2["stop"]' in mermaid


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"states": 5}, "states: a tree has 4 subtrees at most, not 5"),
        ({"transitions": 2}, "transitions: a subtree has one condition; leave it out"),
        ({"machine": {"states": []}}, "machine: tree.states: is not known here; known are subtrees"),
        ({"machine": {"subtrees": []}}, "machine: subtrees: 0 entries found, expected a list of 1 to 4 ent"),
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
            "subtrees[0].rwm: is not known here",
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


SUBSET: dict[str, Any] = {
    "behaviours": ["attraction", "stop", "exploration"],
    "conditions": ["neighbours", "fixed_probability"],
}


@pytest.mark.parametrize("form", ["machine", "tree"])
def test_a_choice_of_modules_is_a_representation_of_its_own(form: str) -> None:
    check_representation("modules", {**SUBSET, "form": form})
    check_representation(
        "modules", {"behaviours": ["exploration"], "conditions": ["grey_floor"], "form": form}
    )
    subject = machines(**SUBSET, form=form)
    assert subject.genome_size == machines(form=form).genome_size
    assert subject.architecture() == machines(form=form).architecture()
    genomes = subject.initials(Streams(1, "x", 0, range(300)))
    for _ in range(3):
        genomes = subject.mutations(genomes, Streams(2, "x", 0, range(300)), severity=0.9, probability=1.0)
    found = [subject.states(genome) for genome in genomes]
    assert {state.behaviour for states in found for state in states} == set(SUBSET["behaviours"])
    conditions = {one.condition for states in found for state in states for one in state.transitions}
    assert conditions == set(SUBSET["conditions"])


@pytest.mark.parametrize("form", ["machine", "tree"])
def test_all_modules_by_name_are_those_that_there_are_by_default(form: str) -> None:
    named = {"behaviours": list(modules.BEHAVIOURS), "conditions": list(modules.CONDITIONS)}
    one, other = machines(form=form), machines(form=form, **named)
    streams = [Streams(seed, "x", 0, range(40)) for seed in (1, 1, 2, 2)]
    mine, its = one.initials(streams[0]), other.initials(streams[1])
    assert mine.tobytes() == its.tobytes()
    options = {"severity": 0.4, "probability": 1.0}
    mine, its = one.mutations(mine, streams[2], **options), other.mutations(its, streams[3], **options)
    assert mine.tobytes() == its.tobytes()
    assert one.weights(mine).tobytes() == other.weights(its).tobytes()
    assert one.likeness(mine).tobytes() == other.likeness(its).tobytes()


def test_a_machine_to_start_from_has_the_modules_that_were_chosen() -> None:
    machine = {
        "states": [
            {
                "behaviour": "exploration",
                "rwm": 9,
                "transitions": [{"to": 1, "condition": "neighbours", "xi": 2, "eta": 3.5}],
            },
            {"behaviour": "attraction", "alpha": 2},
        ]
    }
    subject = machines(**SUBSET, machine=machine)
    assert subject.start is not None
    assert modules.mapping_of(subject.states(subject.start))["states"] == [
        machine["states"][0],
        {**machine["states"][1], "transitions": []},
    ]
    with pytest.raises(
        ValidationError, match=r"states\[0\].behaviour: 'exploration' found, expected one of stop"
    ):
        machines(behaviours=["stop"], machine=machine)
    with pytest.raises(ValidationError, match="expected one of black_floor"):
        machines(conditions=["black_floor"], machine=machine)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"behaviours": ["explore"]}, "unknown behaviour 'explore'; did you mean 'exploration'?"),
        ({"conditions": ["stop"]}, "unknown condition 'stop'; there is: black_floor"),
        ({"behaviours": ["stop", "stop"]}, "behaviours: 'stop' is given twice"),
        ({"conditions": []}, "at least 1 item"),
    ],
)
def test_a_wrong_choice_of_modules_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        machines(**options)
    assert message in str(caught.value)


AUTOMODE_TREE = (
    "--bt-config --nroot 3 --nchildroot 3 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.1642 --n01 5 --a01 4 "
    "--att01 4.0508 --p01 0 --n1 0 --nchild1 2 --n10 6 --c10 3 --p10 8 --w10 15.1397 --n11 5 --a11 0 "
    "--rwm11 4 --p11 0 --n2 0 --nchild2 2 --n20 6 --c20 1 --p20 0.8248 --n21 5 --a21 1 --p21 0"
)


@pytest.mark.parametrize("text", [AUTOMODE_TREE, AUTOMODE_TREE.removeprefix("--bt-config ")])
def test_trees_in_automodes_form(text: str, tmp_path: Path) -> None:
    subtrees = modules.subtrees_from(tree_of(text), 4)
    assert modules.tree_mapping_of(subtrees) == {
        "subtrees": [
            {"condition": "fixed_probability", "probability": 0.1642, "behaviour": "attraction", "alpha": 4},
            {"condition": "neighbours", "xi": 8, "eta": 15.1397, "behaviour": "exploration", "rwm": 4},
            {"condition": "grey_floor", "probability": 0.8248, "behaviour": "stop"},
        ]
    }
    (tmp_path / "best.automode").write_text(f"{text}\n")
    for machine in (text, str(tmp_path / "best.automode")):
        subject = machines(form="tree", machine=machine)
        assert subject.start is not None
        assert subject.states(subject.start) == subtrees


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("--nroot 3", "--nroot 2", "--nroot: 2 is a sequence; expected 3, a sequence with memory"),
        (
            "--n0 0",
            "--n0 2",
            "--n0: 2 is a sequence; expected 0, a selector, as in the trees",
        ),
        ("--n00 6", "--n00 5", "--n00: 5 is an action; expected 6, a condition"),
        ("--n11 5", "--n11 6", "--n11: 6 is a condition; expected 5, an action"),
        ("--nchild0 2", "--nchild0 3", "--nchild0: expected 2, a condition and an action"),
        ("--nchildroot 3", "--nchildroot 4", "--n3: is missing"),
        ("--nchildroot 3", "--nchildroot 5", "--nchildroot: expected an integer from 0 to 4, and found 5"),
        ("--nchildroot 3", "--nchildroot 2", "--n2: is not a part of this"),
        ("--p01 0", "--p01 0.5", "--p01: an action that may succeed is not known here; expected 0"),
        ("--a01 4", "--a01 7", "--a01: expected an integer from 0 to 5, and found 7"),
        ("--c00 5", "--c00 6", "--c00: expected an integer from 0 to 5, and found 6"),
        ("--rwm11 4", "", "--rwm11: is missing"),
        ("--bt-config --nroot 3", "--fsm-config --nstates 2", "describes a machine; leave out form: tree"),
    ],
)
def test_what_is_wrong_in_automodes_trees_is_named(old: str, new: str, words: str) -> None:
    assert old in AUTOMODE_TREE
    with pytest.raises(ValidationError) as caught:
        ModulesOptions(form="tree", machine=AUTOMODE_TREE.replace(old, new))
    assert words in str(caught.value)


@pytest.mark.parametrize("form", ["machine", "tree"])
@given(seed=st.integers(0, 2**60))
def test_what_automode_is_called_with_is_the_machine(form: str, seed: int) -> None:
    subject = machines(form=form)
    states = subject.states(subject.initial(Stream(seed, "x")))
    text = text_of(states, tree=form == "tree")
    assert text is not None
    again = (
        modules.subtrees_from(tree_of(text), 4)
        if form == "tree"
        else modules.states_from(machine_of(text), 4, 4)
    )
    assert again == states


def test_automode_has_no_transition_from_a_state_to_itself() -> None:
    stays = modules.Transition(0, "fixed_probability", {"probability": 0.5})
    assert text_of([modules.State("stop", {}, (stays,))], tree=False) is None
    assert text_of([modules.State("hop", {}, ())], tree=False) is None


def test_the_number_of_transitions_follows_the_form() -> None:
    values = {
        "simulation": "arena",
        "parameters": {"robot": "e-puck-rm1.2"},
        "controller": {"kind": "modules"},
    }
    machine = Experiment.from_mapping(values)
    assert machine.controller.most_transitions == 4
    tree = machine.replace(controller={"form": "tree"})
    assert tree.controller.most_transitions == 1
    assert tree.replace(controller={"form": "machine"}) == machine
    assert Experiment.from_mapping(machine.to_mapping()).with_settings(["controller.form=tree"]) == tree
    with pytest.raises(InputError, match="a subtree has one condition"):
        machine.replace(controller={"form": "tree", "transitions": 2})


@pytest.mark.parametrize("kind", ["nnga", "racing", "random_search", "cma_es", "xnes", "openai_es"])
def test_evolution_begins_with_the_given_machine(kind: str) -> None:
    machine = {
        "states": [
            {
                "behaviour": "exploration",
                "rwm": 30,
                "transitions": [{"to": 1, "condition": "black_floor", "probability": 1.0}],
            },
            {"behaviour": "stop"},
        ]
    }
    experiment = Experiment.from_mapping(
        {
            "simulation": "arena", "parameters": {"robot": "e-puck-rm1.2"},
            "controller": {"kind": "modules", "machine": machine}, "method": {"kind": kind},
        }
    )  # fmt: skip
    representation = experiment.representation()
    method = experiment.new_method(representation)
    np.testing.assert_array_equal(method.start[0], representation.given)
    if method.start_as == "members":
        np.testing.assert_array_equal(method.ask()[0], representation.given)
