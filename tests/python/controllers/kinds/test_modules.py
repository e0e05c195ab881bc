"""Machines of modules as a representation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmwright import Experiment, InputError
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.yaml import dump
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions
from swarmwright.controllers.modules import grammar, machine_mappings
from swarmwright.testing import check_representation
from tests.python.controllers.machines import MACHINE, machines


def test_it_is_a_representation() -> None:
    check_representation("modules")
    check_representation("modules", {"states": 1})
    check_representation("modules", {"states": 6, "transitions": 1})
    check_representation("modules", {"states": 1, "transitions": 1})


@pytest.mark.slow
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
    for name in grammar.BEHAVIOURS:
        assert 0.12 < behaviours.count(name) / len(behaviours) < 0.22
    for name in grammar.CONDITIONS:
        share = sum(one.condition == name for _, one in transitions) / len(transitions)
        assert 0.12 < share < 0.22
    assert all(one.target != source for source, one in transitions)
    targets = np.bincount([one.target for source, one in transitions if source == 3], minlength=4)
    assert (np.abs(targets[:3] / targets.sum() - 1 / 3) < 0.06).all()
    assert {len(s.transitions) for states in of_four for s in states} == {1, 2, 3, 4}
    assert {len(s.transitions) for states in found if len(states) == 1 for s in states} == {0}
    for states in of_four:
        for name, (low, high, whole) in grammar.RANGES.items():
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
    expected = machine_mappings.parse_states(MACHINE, 4, 4)
    found = [subject.states(genome) == expected for genome in genomes]
    assert 2 <= sum(found) <= 30
    again = machine_mappings.parse_states(machine_mappings.machine_mapping_of(expected), 4, 4)
    assert again == expected
    weights = grammar.weights_of(expected, 4, 4)
    assert grammar.states_of({**subject.architecture(), "weights": weights}) == expected
    check_representation("modules", {"machine": MACHINE})


def test_a_machine_may_be_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(dump(MACHINE))
    options = ModulesOptions(machine=str(file))
    assert options.machine == MACHINE
    file.unlink()
    with pytest.raises(ValidationError, match=r"machine\.yaml") as caught:
        ModulesOptions(machine=str(file))
    assert "expected a mapping, a YAML file, or AutoMoDe's --nstates" in str(caught.value)


def test_a_mistake_in_a_machine_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    for text, problem in (
        ("states:\n  - behaviour: exploration\n    rwm: 900\n", ":3: states[0].rwm: 900 found"),
        ("states:\n  - {behaviour: stop}\nstart: 0\n", ":3: start: unknown key"),
        ("--nstates 2 --s0 99\n", ":1: --s0: 99 found, expected an integer from 0 to 5"),
    ):
        file.write_text(text)
        with pytest.raises(ValidationError) as caught:
            ModulesOptions(machine=str(file))
        assert f"machine: {file}{problem}" in str(caught.value)


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
        (changed("states", value=[]), "machine.states: 0 entries found, expected a list of 1 to 4 entries"),
        (changed("colour", value="red"), "machine.colour: unknown key; expected one of states"),
        (changed("states", 0, "behaviour", value="fly"), "states[0].behaviour: 'fly' found, expected one of"),
        (
            changed("states", 0, "rwm", value=None),
            "states[0].rwm: None found, expected an integer from 1 to 100",
        ),
        (changed("states", 0, "rwm", value=7.5), "states[0].rwm: 7.5 found"),
        (changed("states", 1, "rwm", value=7), "states[1].rwm: unknown key"),
        (changed("states", 1, "name", value="walk"), "states[1].name: 'walk' occurs twice"),
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


def test_other_sensors_are_refused_with_what_is_needed() -> None:
    with pytest.raises(InputError, match=r"modules needs 9 sensors .* but the simulation has 4 and 1"):
        Modules(ModulesOptions(), sensors=4, actuators=1)
    experiment = Experiment.from_mapping({"simulation": "elsewhere", "controller": {"kind": "modules"}})
    with pytest.raises(InputError, match=r"use a robot such as e-puck-rm1\.2"):
        experiment.representation(4, 1)


def test_the_number_of_transitions_follows_the_form() -> None:
    values = {
        "simulation": "arena",
        "parameters": {"robot": "e-puck-rm1.2"},
        "controller": {"kind": "modules"},
    }
    machine = Experiment.from_mapping(values)
    assert isinstance(machine.controller, ModulesOptions)
    assert machine.controller.most_transitions == 4
    tree = machine.replace(controller={"form": "tree"})
    assert isinstance(tree.controller, ModulesOptions)
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
    np.testing.assert_array_equal(method.start[0], representation.start_genome)
    if method.start_as == "members":
        np.testing.assert_array_equal(method.ask()[0], representation.start_genome)
