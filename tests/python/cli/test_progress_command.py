"""`swarmwright progress`, in this process."""

import json
from pathlib import Path

import pytest

import swarmwright
from swarmwright.cli._main import run as command
from tests.python.runs.optimization.test_competing import MINISIM, POPULATIONS


def test_text_figure_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "run")
    arguments = ["progress", str(run.path), "--champions", "3", "--episodes", "2", "--servers", "in-process"]
    figure = tmp_path / "progress.svg"
    assert command([*arguments, "--out", str(figure)]) == 0
    text = capsys.readouterr().out
    assert "3 champions of each side met all of the other side, 2 episodes each." in text
    assert "agents: " in text
    assert "Generation to take: " in text
    assert f"export {run.path} --generation" in text
    drawing = figure.read_text(encoding="utf-8")
    assert "generation of defenders" in drawing
    assert command([*arguments, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["sides"].keys() == {"agents", "defenders"}
    assert facts["champions"], facts["episodes"] == (3, 2)
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
    assert "the experiment is no competition" in capsys.readouterr().err
    assert command(["progress", str(tmp_path / "nothing")]) == 2
