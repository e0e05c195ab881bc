"""Machines of modules as YAML, Graphviz and Mermaid: what is written is the machine."""

from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.common.yaml import read
from swarmwright.controllers.kinds.modules.automode import parse_tree
from swarmwright.controllers.modules import grammar, machine_mappings
from swarmwright.export.exporting import write
from swarmwright.export.machine import Machine
from swarmwright.export.sequences import measure_difference
from tests.python.export.specifications import ALL, few, subject


@pytest.mark.parametrize("name", [name for name in ALL if name.startswith("modules")])
def test_what_is_written_is_the_machine(name: str, tmp_path: Path) -> None:
    exporter = Machine()
    write(exporter.files(subject(ALL[name]), "robot"), tmp_path)
    sequences = few(ALL[name], 300)
    assert measure_difference(sequences, exporter.run(tmp_path, "robot", sequences)) == (0.0, 0)
    states = grammar.states_of(ALL[name])
    if grammar.is_tree(ALL[name]):
        assert machine_mappings.parse_subtrees(read(tmp_path / "robot.yaml").values, 4) == states
        for file, arrow in (("robot.dot", " -> "), ("robot.mmd", " --> ")):
            assert (tmp_path / file).read_text().count(arrow) == 3 * len(states)
        text = (tmp_path / "robot.automode").read_text()
        assert machine_mappings.parse_subtrees(parse_tree(text), 4) == states
        return
    assert machine_mappings.parse_states(read(tmp_path / "robot.yaml").values, 16, 4) == states
    own = any(one.target == index for index, state in enumerate(states) for one in state.transitions)
    assert (tmp_path / "robot.automode").exists() != own
    transitions = sum(len(state.transitions) for state in states)
    assert (tmp_path / "robot.dot").read_text().count(" -> ") == transitions
    assert (tmp_path / "robot.mmd").read_text().count(" --> ") == transitions + 1


def test_another_machine_would_be_found_out(tmp_path: Path) -> None:
    exporter = Machine()
    write(exporter.files(subject(ALL["modules-other"]), "robot"), tmp_path)
    sequences = few(ALL["modules"], 300)
    assert measure_difference(sequences, exporter.run(tmp_path, "robot", sequences))[1] > 0


def test_others_are_refused() -> None:
    with pytest.raises(InputError, match="the kind 'layered' is not a machine of behaviours"):
        Machine().files(subject(ALL["layered-direct"]), "robot")
