"""Values of a candidate are written into the files of its model."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, Run, models, optimize
from swarmwright.core.xml import read as read_xml
from tests.python.models.conftest import Edited
from tests.python.models.test_behaviour import WALK

SMALL = {"servers": "local", "method": {"population": 8, "generations": 2}}


def evolved(paths: list[Path], folder: Path, **options: Any) -> Run:
    imported = models.load(paths, target=folder / "x.yaml", **options)
    return Run.open(optimize(imported.experiment.replace(**SMALL), out=folder / "run").path)


def test_parameters_get_values_with_their_scale(drawn: list[Path], tmp_path: Path) -> None:
    run = evolved(drawn, tmp_path)
    values = run.best.controller.parameters
    _, files = models.write_back(run, drawn, output=tmp_path / "back")
    assert [file.name for file in files] == ["problem.xml", "parameters.json", "candidate.json"]
    written = json.loads((tmp_path / "back" / "parameters.json").read_text())["parameters"]
    original = json.loads(drawn[1].read_text())["parameters"]
    assert [{key: one[key] for key in one if key != "value"} for one in written] == original
    avoidance, steps = (one["value"] for one in written)
    assert avoidance * 0.1 == pytest.approx(values["avoidance"], rel=1e-6)
    assert 0 <= avoidance <= 50
    assert (steps, type(steps)) == (values["maxSteps"], int)
    candidate = json.loads((tmp_path / "back" / "candidate.json").read_text())
    assert [one["value"] for one in candidate] == list(values.values())
    entries = read_xml(tmp_path / "back" / "problem.xml").one("properties").children
    assert entries[0].attributes["value"] == str(steps)
    assert models.load([*files[:2], drawn[2]]).experiment.controller.kind == "parameter_set"


def test_a_number_of_agents_is_written(edited: Edited, tmp_path: Path) -> None:
    comment = '<!-- <SwarmMember name="Agent" launchFile="x" number="3"/> -->'
    paths = [
        edited("problem.xml"),
        edited("parameters.json", ("maxSteps", "agent")),
        edited("swarm.xml", ("<Swarm name", f"{comment}\n<Swarm name")),
    ]
    run = evolved(paths, tmp_path)
    models.write_back(run, paths[1:], output=tmp_path / "back")
    agents = run.best.controller.parameters["numAgents"]
    text = (tmp_path / "back" / "swarm.xml").read_text()
    assert text == paths[2].read_text().replace('"3"/>\n</S', f'"{agents}"/>\n</S')
    assert comment in text


def test_a_behaviour_becomes_that_of_the_candidate(edited: Edited, tmp_path: Path) -> None:
    walk = tmp_path / "walk.scxml"
    walk.write_text(WALK)
    run = evolved([edited("problem.xml"), walk], tmp_path)
    _, files = models.write_back(run, [walk], output=tmp_path / "back", candidate=0)
    again = models.load([edited("problem.xml"), *files], target=tmp_path / "y.yaml")
    assert again.experiment.start_from is not None
    assert again.experiment.start_from[0]["weights"] == run.evaluation(0).genome.tolist()


def test_files_of_which_nothing_was_evolved_are_refused(drawn: list[Path], tmp_path: Path) -> None:
    run = evolved(drawn, tmp_path)
    with pytest.raises(InputError, match=r"swarm\.xml: nothing in it was evolved; the run evolved the par"):
        models.write_back(run, drawn[2:], output=tmp_path / "back")
    (tmp_path / "back").mkdir()
    (tmp_path / "back" / "parameters.json").write_text("{}")
    with pytest.raises(InputError, match="is there already"):
        models.write_back(run, drawn[1:2], output=tmp_path / "back")


def test_the_command_line(program: Any, drawn: list[Path], tmp_path: Path) -> None:
    evolved(drawn, tmp_path)
    done = program("export", "run", "--model", drawn[1], "--output", "back", "--candidate", "0:2")
    assert done.returncode == 0, done.stderr
    assert "Candidate 2 of generation 0" in done.stdout
    for arguments in (["--model", drawn[1]], ["--model", drawn[1], "--to", "c", "--output", "x"]):
        wrong = program("export", "run", *arguments)
        assert wrong.returncode == 2
        assert "--model writes into a folder" in wrong.stderr
