"""`swarmwright progress`, in this process."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import swarmwright
from swarmwright import InputError
from swarmwright.analysis.competition import measure_progress
from swarmwright.cli._main import run as command
from swarmwright.runs.matches import FIRST_SEED
from tests.python.runs.optimization.test_competing import MINISIM, POPULATIONS


def test_text_figure_table_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    arguments = ["progress", str(run.path), "--champions", "3", "--episodes", "2", "--servers", "in-process"]
    figure = tmp_path / "progress.svg"
    table = tmp_path / "progress.csv"
    assert command([*arguments, "--out", str(figure), "--csv", str(table)]) == 0
    text = capsys.readouterr().out
    assert "3 champions of each side met those of all other sides, 2 episodes each." in text
    assert "agents: " in text
    assert "Generation to take: " in text
    assert f"export {run.path} --generation" in text
    drawing = figure.read_text(encoding="utf-8")
    assert "generation of defenders" in drawing
    assert command([*arguments, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["sides"].keys() == {"agents", "defenders"}
    assert (facts["champions"], facts["episodes"]) == (3, 2)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["side"] for row in rows] == ["agents"] * 3 + ["defenders"] * 3
    for name, side in facts["sides"].items():
        own = [row for row in rows if row["side"] == name]
        assert [int(row["generation"]) for row in own] == side["generations"] == [0, 2, 3]
        for column in ("means", "ratings", "ratings_low", "ratings_high"):
            assert [float(row[column]) for row in own] == side[column]
    assert facts["cycles"] == any(side["cycles"] for side in facts["sides"].values())


def test_the_exported_controller_is_the_champion(tmp_path: Path) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    for generation, champion in enumerate(run.champions("defenders")):
        evaluation = run.evaluation(None, generation)
        assert evaluation.genome[-len(champion.genome) :].tobytes() == champion.genome.tobytes()
        assert evaluation.number == champion.evaluation


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--champions", "1"], "'--champions': 1 is not in the range"),
        (["--episodes", "x"], "'--episodes'"),
        (["--out", "progress.bmp"], "progress.bmp"),
        (["--csv", "progress.txt"], "this table ends with .csv"),
    ],
)
def test_mistakes_are_a_message(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    assert command(["progress", str(run.path), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_other_runs_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = swarmwright.optimize({**MINISIM, "parameters": {}}, servers="in-process", out=tmp_path / "run")
    assert command(["progress", str(run.path)]) == 2
    assert "the experiment is not a competition" in capsys.readouterr().err
    assert command(["progress", str(tmp_path / "nothing")]) == 2


def test_the_match_of_a_cell_is_replayed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    outcomes = measure_progress(run, champions=4, episodes=2, servers="in-process").sides[0].outcomes
    fitness = []
    for episode in ("0", "1"):
        arguments = ["--match", "3,1", "--episode", episode]
        assert command(["replay", str(run.path), *arguments, "--json"]) == 0
        last = json.loads(capsys.readouterr().out.splitlines()[-1])
        assert (last["match"], last["generation"]) == ([3, 1], None)
        assert last["seed"] == FIRST_SEED + int(episode)
        fitness.append(last["fitness"])
    assert np.mean(fitness) == pytest.approx(outcomes[3, 1])
    page = tmp_path / "match.html"
    assert command(["replay", str(run.path), "--match", "3,1", "--save", str(page)]) == 0
    assert "Agents of generation 3 against defenders of generation 1." in capsys.readouterr().out
    assert "agents of generation 3 against defenders of generation 1" in page.read_text("utf-8")
    recorded = run.evaluation(None, 2)
    arguments = ["--match", "2,2", "--seed", str(recorded.seeds[1]), "--json"]
    assert command(["replay", str(run.path), *arguments]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["fitness"] == recorded.episodes[1], "the last match of a generation is that of its champions"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--match", "3"], "'3' is not a list of generations such as 40,3"),
        (["--match", "3,-1"], "is not a list of generations"),
        (["--match", "\u0663,1"], "is not a list of generations"),
        (["--match", "3,4"], "no generation 4"),
        (["--match", "3,0,0"], "match: must have a generation of each of agents, defenders, not 3 numbers"),
        (["--match", "3,0", "--candidate", "1"], "--match and --candidate exclude each other"),
        (["--match", "3,0", "--controller", "."], "--controller and --match exclude each other"),
    ],
)
def test_matches_that_are_none_are_a_message(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    assert command(["replay", str(run.path), *arguments]) == 2
    assert message in capsys.readouterr().err
    with pytest.raises(InputError, match="episode -1: must be at least 0"):
        run.replay(match=[0, 0], episode=-1)


def test_runs_without_sides_have_no_matches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = swarmwright.optimize({**MINISIM, "parameters": {}}, servers="in-process", out=tmp_path / "run")
    assert command(["replay", str(run.path), "--match", "0,0"]) == 2
    assert "the experiment is not a competition" in capsys.readouterr().err
