"""FREVO's networks get FREVO's fitness."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Controller, InputError, frevo

Edited = Callable[..., Path]


@pytest.mark.parametrize("name", ["emergency_exit_stadium", "emergency_exit_random"])
def test_all_networks_score_as_in_frevo(data: Path, name: str) -> None:
    scores = frevo.score(data / f"{name}.zre")
    assert [one.index for one in scores] == list(range(50))
    assert len({one.frevo for one in scores}) > 20
    for one in scores:
        assert one.fitness == pytest.approx(one.frevo, rel=0, abs=1e-9)
    assert scores.max_difference <= 1e-9
    assert scores.notes == ()


@pytest.mark.parametrize("name", ["gaspecies", "three_layers", "multi_layer", "complete", "hebbian"])
def test_networks_of_all_methods_and_kinds_score_as_in_frevo(data: Path, name: str) -> None:
    scores = frevo.score(data / f"{name}.zre")
    assert len(scores) >= 5
    assert len({one.frevo for one in scores}) > 1
    assert scores.max_difference == 0
    told = " ".join(scores.notes)
    assert ("sigmoid is computed to 1e-7" in told) == (name in {"three_layers", "multi_layer"})


def test_relu_is_scored_and_said_to_differ(data: Path) -> None:
    scores = frevo.score(data / "relu.zre")
    assert len(scores) == 5
    assert scores.max_difference > 1
    assert "agents of Emergency Exit stand still if one exceeds 1.25" in scores.notes[0]


def test_method_and_ranking_do_not_matter(edited: Edited) -> None:
    path = edited(
        "emergency_exit_random.zre",
        ('class="nnga.NNGA"', 'class="somebody.Method"'),
        ('<methodentry key="xoverMethod"', "<parameter key="),
        ('class="AbsoluteRanking.AbsoluteRanking"', 'class="swissSystem.SwissSystem"'),
    )
    text = path.read_text().replace("<parameter key=", "<parameter ")
    path.write_text(text)
    assert frevo.score(path).max_difference == 0


def test_problem_and_representation_matter(edited: Edited) -> None:
    path = edited(
        "emergency_exit_random.zre",
        ('class="emergencyexit.EmergencyExit"', 'class="cam.Cam"'),
        ('class="fullyMeshedNet.FullyMeshedNet"', 'class="bulk.Bulk"'),
    )
    with pytest.raises(InputError) as caught:
        frevo.score(path)
    first, second = str(caught.value).splitlines()
    assert "<problem>: the class 'cam.Cam' has no counterpart in Swarmwright" in first
    assert "<representation>: the class 'bulk.Bulk' has no counterpart in Swarmwright" in second
    assert "--" not in first + second  # nothing can stand in their place


def test_another_network_scores_otherwise(edited: Edited, data: Path) -> None:
    # The first network's first bias.
    path = edited("emergency_exit_stadium.zre", ("<bias>-0.40387747</bias>", "<bias>2.5f</bias>"))
    scores = frevo.score(path, field=data / "stadium.json")
    assert scores.candidates[0].difference > 1
    assert max(one.difference for one in scores.candidates[1:]) <= 1e-9


def test_a_larger_number_of_evaluations_adds_up(edited: Edited) -> None:
    def total(evaluations: int, first: int = 0) -> float:
        path = edited(
            "emergency_exit_random.zre",
            (
                'key="NumberofEvaluations" type="INT" value="10"',
                f'key="NumberofEvaluations" value="{evaluations}"',
            ),
            (
                'key="seedforEmergencyExits" type="INT" value="0"',
                f'key="seedforEmergencyExits" value="{first}"',
            ),
        )
        return frevo.score(path).candidates[0].fitness

    assert total(3) + total(7, first=3) == pytest.approx(total(10), abs=1e-9)


@pytest.mark.slow
def test_score_command(program: Any, data: Path) -> None:
    shown = program("score", data / "emergency_exit_stadium.zre", "--json")
    assert (shown.returncode, shown.stderr) == (0, "")
    last = json.loads(shown.stdout.splitlines()[-1])
    assert list(last) == ["candidates", "max_difference"]
    assert last["max_difference"] <= 1e-9
    assert [list(one) for one in last["candidates"]] == [["index", "fitness", "frevo"]] * 50
    assert last["candidates"][0]["frevo"] == 0.44

    plain = program("score", data / "emergency_exit_stadium.zre")
    lines = plain.stdout.splitlines()
    assert lines[0].split() == ["candidate", "fitness", "FREVO", "difference"]
    assert lines[1].split() == ["0", "0.44", "0.44", "0"]
    assert lines[-1] == "50 candidates, largest difference 0"


WEIGHT = '<weight from="3">-1.7659435</weight>'


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        (("populations count", "population count"), "not valid XML: mismatched tag"),
        ((WEIGHT, '<weight from="3">much</weight>'), ":75: <weight>: 'much' found, expected a finite number"),
        ((WEIGHT, '<weight from="3">1e39</weight>'), ":75: <weight>: '1e39' found, expected a finite number"),
        ((WEIGHT, ""), ":71: <weights>: 13 weights found, expected 14, one from every node"),
        ((WEIGHT, '<weight from="2">1</weight>'), "duplicate from='2' (first in line 74)"),
        ((WEIGHT, '<weight from="14">1</weight>'), ":71: <weights>: the weight from 3 is missing"),
        (('<node nr="11"', '<node nr="21"'), "<FullyMeshedNet>: the node 11 is missing; expected 0 to 13"),
        (('nodes="14"', 'nodes="x"'), "nodes 'x' found, expected a whole number"),
        (('nodes="14"', 'nodes="11"'), "10 and output_nodes 2 found among 11 nodes"),
        (('nodes="14"', 'nodes="99999999999"'), "expected a whole number of at most 10000"),
        (('input_nodes="10"', ""), "<FullyMeshedNet>: the attribute input_nodes is missing"),
        ((' fitness="0.44"', ""), "the attribute fitness is missing"),
        ((' fitness="0.44"', ' fitness="NaN"'), "fitness 'NaN' found, expected a finite number"),
        (('activation_function="LINEAR"', 'activation_function="RELU"'), "but the session has LINEAR"),
        (
            ('key="random_source" type="BOOLEAN" value="false"', 'key="random_source" value="true"'),
            "random numbers",
        ),
        (("<bias>-0.40387747</bias>", ""), "<node>: no <bias> inside; expected one"),
    ],
)
def test_a_malformed_result_is_refused(edited: Edited, change: tuple[str, str], answer: str) -> None:
    path = edited("emergency_exit_stadium.zre", change)
    with pytest.raises(InputError) as caught:
        frevo.score(path)
    assert answer in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_networks_of_another_size_are_refused(edited: Edited, data: Path) -> None:
    text = (data / "emergency_exit_stadium.zre").read_text(encoding="utf-8")
    start, end = text.index("<population>"), text.index("</population>")
    tiny = (
        '<population><FullyMeshedNet input_nodes="1" output_nodes="1" nodes="2" fitness="0"><nodes>'
        '<node nr="0"/><node nr="1"><bias>0</bias><weights><weight from="0">1</weight>'
        '<weight from="1">0</weight></weights></node></nodes></FullyMeshedNet>'
    )
    path = edited("emergency_exit_stadium.zre", (text[start:end], tiny))
    with pytest.raises(InputError, match=r"sensors: 1, but simulation emergency_exit has 10"):
        frevo.score(path, field=data / "stadium.json")


def test_a_session_has_nothing_to_score(data: Path) -> None:
    with pytest.raises(InputError, match=r"no <population> inside: a session, no result; give the \.zre"):
        frevo.score(data / "emergency_exit_stadium.zse")


@pytest.mark.slow
def test_a_candidate_is_saved_as_a_controller(data: Path, program: Any, tmp_path: Path) -> None:
    file, scores = data / "hebbian.zre", frevo.score(data / "hebbian.zre")
    for options, index in (((), scores.best.index), (("--candidate", "7"), 7)):
        target = tmp_path / f"{index}.json"
        shown = program("score", file, "--save", target, *options)
        assert shown.stdout.splitlines()[-1] == f"{target}: the controller of candidate {index}"
        assert (
            Controller.load(target).specification
            == Controller(scores.candidates[index].specification).specification
        )
    assert scores.best.index != 7
    refusals: tuple[tuple[list[str | Path], str], ...] = (
        (["--save", tmp_path / "x.json", "--candidate", "10"], "the file has the candidates 0 to 9"),
        (["--candidate", "1"], "--candidate needs --save; add it"),
        (["--save", tmp_path / "none" / "x.json"], "none"),
    )
    for wrong, answer in refusals:
        refused = program("score", file, *wrong)
        assert refused.returncode == 2
        assert answer in refused.stderr


@pytest.mark.slow
@pytest.mark.parametrize("episodes", ["100001", "10000000000000", "1" + "0" * 25])
def test_too_many_evaluations_are_refused_before_memory_is_taken(edited: Edited, episodes: str) -> None:
    path = edited(
        "emergency_exit_random.zre",
        ('key="NumberofEvaluations" type="INT" value="10"', f'key="NumberofEvaluations" value="{episodes}"'),
    )
    with pytest.raises(InputError, match=f"NumberofEvaluations: {episodes} found, expected .* most 100000"):
        frevo.score(path)


@pytest.mark.parametrize("zeros", [1, 9, 5000])
def test_leading_zeros_do_not_matter_in_counts(edited: Edited, zeros: int) -> None:
    path = edited("emergency_exit_random.zre", ('input_nodes="10"', f'input_nodes="{"0" * zeros}10"'))
    assert frevo.score(path).max_difference == 0
    wrong = edited("emergency_exit_random.zre", ('input_nodes="10"', f'input_nodes="{"0" * zeros}10001"'))
    with pytest.raises(
        InputError, match=r"input_nodes '0.*' found, expected a whole number of at most 10000"
    ):
        frevo.score(wrong)


@pytest.mark.parametrize("text", ['{"kind": "layered"}', "simulation: minisim", "import numpy"])
def test_a_file_that_is_not_of_frevo_is_said_to_be_evaluated_otherwise(text: str, tmp_path: Path) -> None:
    file = tmp_path / "best.json"
    file.write_text(text)
    with pytest.raises(InputError, match=r"is not a result of FREVO \(\.zre\).*--controller FILE"):
        frevo.score(file)
