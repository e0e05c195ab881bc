"""Machines and trees in AutoMoDe's form."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers.kinds.modules.automode import format_command_line, parse_machine, parse_tree
from swarmwright.controllers.kinds.modules.representation import ModulesOptions
from swarmwright.controllers.modules import grammar, machine_mappings, machine_texts
from tests.python.controllers.machines import AUTOMODE, machines


def test_machines_in_automodes_form() -> None:
    states = machine_mappings.parse_states(parse_machine(AUTOMODE), 4, 4)
    assert machine_texts.as_text(states) == (
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
    "line",
    [
        "-c mission.argos --seed 3 --fsm-config {}",
        "./automode_main -n -c my-missions/aac.argos --seed 1234 -t 12 --fsm-config {}\n",
        "automode_main \\\n  -c 'a mission.argos' \\\n  --fsm-config \\\n  {}",
        '--fsm-config "{}"',
        "automode_main -c mission.argos --fsm-config {} | sed '/STOP/d' > scores.txt",
    ],
)
def test_whole_command_lines_of_automode_are_read(line: str, tmp_path: Path) -> None:
    plain = AUTOMODE.replace("--fsm-config", "").strip()
    text = line.format(plain)
    assert parse_machine(text) == parse_machine(AUTOMODE)
    (tmp_path / "fsm.txt").write_text(text)
    for machine in (text, str(tmp_path / "fsm.txt")):
        read = ModulesOptions(machine=machine).machine
        assert isinstance(read, str)
        assert parse_machine(read) == parse_machine(AUTOMODE)
    tree = f"-c mission.argos --seed 3 {AUTOMODE_TREE}"
    assert parse_tree(tree) == parse_tree(AUTOMODE_TREE)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("--nstates 2 --s0", "expected pairs such as"),
        ("nstates 2", "expected a mapping, a YAML file, or AutoMoDe's --nstates"),
        ("--nstates 1 --s0 1 --s0 1", "a parameter occurs twice"),
        ("--nstates 0", "states: 0 entries found"),
        ("--nstates 1 --s0 6", "--s0: 6 found, expected an integer from 0 to 5"),
        ("--nstates 1 --s0 0", "--rwm0: is missing; expected a number"),
        ("--nstates 1 --s0 x", "--s0: 'x' found, expected a number"),
        ("--nstates 1 --s0 1 --s1 1", "--s1: is not a parameter of this machine"),
        ("--nstates 2 --s0 1 --s1 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 2", "probability: 2.0 found"),
        (
            "automode_main -c a.argos --fsm-config --nstates 1 --s0 2 --brd0 0",
            "machine: --brd0: is not a parameter",
        ),
        (
            "automode_main --fsm-config --nstates 1 --s0 0 --rwm0 0",
            "states[0].rwm: 0 found, expected an integer",
        ),
        ("--bt-config --nroot 3 --nchildroot 1", "AutoMoDe's --bt-config describes a tree; set form: tree"),
    ],
)
def test_what_is_wrong_in_automodes_form_is_named(text: str, words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        ModulesOptions(machine=text)
    assert words in str(caught.value)


AUTOMODE_TREE = (
    "--bt-config --nroot 3 --nchildroot 3 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.1642 --n01 5 --a01 4 "
    "--att01 4.0508 --p01 0 --n1 0 --nchild1 2 --n10 6 --c10 3 --p10 8 --w10 15.1397 --n11 5 --a11 0 "
    "--rwm11 4 --p11 0 --n2 0 --nchild2 2 --n20 6 --c20 1 --p20 0.8248 --n21 5 --a21 1 --p21 0"
)


@pytest.mark.parametrize("text", [AUTOMODE_TREE, AUTOMODE_TREE.removeprefix("--bt-config ")])
def test_trees_in_automodes_form(text: str, tmp_path: Path) -> None:
    subtrees = machine_mappings.parse_subtrees(parse_tree(text), 4)
    assert machine_mappings.tree_mapping_of(subtrees) == {
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
        ("--nchildroot 3", "--nchildroot 5", "--nchildroot: 5 found, expected an integer from 0 to 4"),
        ("--nchildroot 3", "--nchildroot 2", "--n2: is not a parameter of this"),
        ("--p01 0", "--p01 0.5", "--p01: actions that may succeed are not supported; expected 0"),
        ("--a01 4", "--a01 7", "--a01: 7 found, expected an integer from 0 to 5"),
        ("--c00 5", "--c00 6", "--c00: 6 found, expected an integer from 0 to 5"),
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
    text = format_command_line(states, tree=form == "tree")
    assert text is not None
    again = (
        machine_mappings.parse_subtrees(parse_tree(text), 4)
        if form == "tree"
        else machine_mappings.parse_states(parse_machine(text), 4, 4)
    )
    assert again == states


def test_automode_has_no_transition_from_a_state_to_itself() -> None:
    stays = grammar.Transition(0, "fixed_probability", {"probability": 0.5})
    assert format_command_line([grammar.State("stop", {}, (stays,))], tree=False) is None
    assert format_command_line([grammar.State("hop", {}, ())], tree=False) is None
