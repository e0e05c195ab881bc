"""Values of a candidate are written into the files of its model."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, Run, optimize
from swarmwright.common.xml import read as read_xml
from swarmwright.interop import models
from swarmwright.interop.models import _files as models_files
from tests.python.interop.models.conftest import Edited
from tests.python.interop.models.test_behaviour import WALK

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
    entries = read_xml(tmp_path / "back" / "problem.xml").find_one("properties").children
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
    with pytest.raises(
        InputError, match=r"swarm\.xml: the run evolved nothing in these files; it evolved the par"
    ):
        models.write_back(run, drawn[2:], output=tmp_path / "back")
    (tmp_path / "back").mkdir()
    (tmp_path / "back" / "parameters.json").write_text("{}")
    with pytest.raises(InputError, match="already exists"):
        models.write_back(run, drawn[1:2], output=tmp_path / "back")


@pytest.mark.slow
def test_the_command_line(program: Any, drawn: list[Path], tmp_path: Path) -> None:
    evolved(drawn, tmp_path)
    done = program("export", "run", "--model", drawn[1], "--output", "back", "--candidate", "0:2")
    assert done.returncode == 0, done.stderr
    assert "Candidate 2 of generation 0" in done.stdout
    for arguments, message in (
        ([], "--model needs --output"),
        (["--to", "c", "--output", "x"], "--model and --to exclude each other"),
    ):
        wrong = program("export", "run", "--model", drawn[1], *arguments)
        assert wrong.returncode == 2
        assert message in wrong.stderr


@pytest.mark.parametrize(
    ("encoding", "declared", "mark"),
    [
        ("iso-8859-1", "ISO-8859-1", b""),
        ("windows-1252", "windows-1252", b""),
        ("utf-16-le", "UTF-16", b"\xff\xfe"),
        ("utf-16-be", "UTF-16", b"\xfe\xff"),
        ("utf-8", "UTF-8", b"\xef\xbb\xbf"),
        ("utf-8", None, b""),
    ],
)
def test_xml_keeps_its_encoding(
    edited: Edited, tmp_path: Path, encoding: str, declared: str | None, mark: bytes
) -> None:
    problem, parameters = edited("problem.xml"), edited("parameters.json")
    head = "" if declared is None else f'<?xml version="1.0" encoding="{declared}"?>'
    text = problem.read_text().partition("?>")[2].replace("Maximum", "Größtmögliche").replace("\n", "\r\n")
    problem.write_bytes(mark + (head + text).encode(encoding))
    run = evolved([problem, parameters], tmp_path)
    models.write_back(run, [problem], output=tmp_path / "back")
    written = (tmp_path / "back" / "problem.xml").read_bytes()
    steps = run.best.controller.parameters["maxSteps"]
    assert written == problem.read_bytes().replace('"25"'.encode(encoding), f'"{steps}"'.encode(encoding))
    assert models.load([tmp_path / "back" / "problem.xml", parameters]).experiment.simulation == "minisim"


def test_characters_that_an_encoding_lacks_are_written_by_number(tmp_path: Path) -> None:
    from swarmwright.interop.models._write_back import _update_tags

    path = tmp_path / "problem.xml"
    head = '<?xml version="1.0" encoding="ISO-8859-1"?>'
    path.write_text(f'{head}<p><propentry key="höhe" value="1"/></p>', encoding="latin-1")
    (tmp_path / "back.xml").write_bytes(_update_tags(path, lambda name: "λ" if name == "höhe" else None))
    root = read_xml(tmp_path / "back.xml")
    assert root.children[0].attributes == {"key": "höhe", "value": "λ"}


def test_a_whole_scale_keeps_whole_numbers(edited: Edited, tmp_path: Path) -> None:
    paths = [
        edited("problem.xml"),
        edited("parameters.json", ('15, "max": 30, "scale": 1}', '1, "max": 3, "scale": "10"}')),
    ]
    run = evolved(paths, tmp_path)
    options = run.experiment.controller.model_dump()["parameters"]["maxSteps"]
    assert (options["type"], options["range"]) == ("integer", [10, 30])
    steps = run.best.controller.parameters["maxSteps"]
    assert isinstance(steps, int)
    models.write_back(run, paths[1:], output=tmp_path / "back")
    written = json.loads((tmp_path / "back" / "parameters.json").read_text())["parameters"][1]
    assert written["value"] == steps / 10
    assert isinstance(written["value"], int) == (steps % 10 == 0)


def test_scales_whose_numbers_are_too_large_for_integers_are_real(edited: Edited) -> None:
    parameters = edited("parameters.json", ('"max": 50, "scale": "0.1"', '"max": 50, "scale": 1e6'))
    (one, _) = models_files.load(parameters).optimised
    assert not one.whole
    assert one.range == [0.0, 5e7]
