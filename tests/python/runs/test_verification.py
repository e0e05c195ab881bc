"""best.json compared with the record."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.cli._main import run as swarmwright
from swarmwright.common.arrays import shortest
from swarmwright.runs.store.verification import verify as verify_store
from swarmwright.runs.verification import verify

METHOD = {"kind": "random_search", "population": 6, "generations": 3}
LAYERED: dict[str, Any] = {"simulation": "minisim", "controller": {"hidden": [2]}}
MODULES: dict[str, Any] = {
    "simulation": "arena",
    "parameters": {"mission": "aggregation", "robots": 2, "robot": "e-puck-rm1.2", "duration": 2},
    "controller": {"kind": "modules"},
}
Edit = Callable[[dict[str, Any]], object]


def made(folder: Path, values: dict[str, Any]) -> Run:
    """A finished run."""
    common = {"method": METHOD, "servers": "in-process", "validate": False}
    return optimize(Experiment.from_mapping({**values, **common}), out=folder / "run")


def edit(run: Run, change: Edit) -> None:
    """Edit best.json."""
    file = run.path / "best.json"
    values = json.loads(file.read_text())
    change(values)
    file.write_text(json.dumps(values))


def _weight(values: dict[str, Any]) -> None:
    values["controller"]["weights"][0] += 0.5


def _gene(values: dict[str, Any]) -> None:
    values["genome"][0] += 0.5


EDITS: list[tuple[Edit, str]] = [
    (lambda values: values.update(fitness=99), "its fitness is 99, but that of candidate"),
    (lambda values: values.update(candidate=99), "names candidate 99 of generation"),
    (lambda values: values.update(generation="0"), "does not name a candidate of the run"),
    (lambda values: values.pop("generation"), "does not name a candidate of the run"),
    (lambda values: values.pop("controller"), "has no controller"),
    (_weight, "its weights are not those of candidate"),
]


@pytest.mark.parametrize(("change", "said"), EDITS)
def test_an_edited_file_is_found_and_written_again(
    change: Edit, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = made(tmp_path, LAYERED)
    assert verify(run.path).problems == []
    edit(run, change)
    (problem,) = verify(run.path).problems
    assert problem.message.startswith("best.json: ")
    assert said in problem.message
    assert verify_store(run.path).problems == [], "the record is as it was"
    assert swarmwright(["runs", "verify", str(run.path)]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"{run.path}: damaged: {problem.message}"
    assert second == f"{run.path}: generations 0 to 2 are intact"
    resume(run)
    assert verify(run.path).problems == []


@pytest.mark.parametrize(("change", "said"), [(_weight, "its weights are not"), (_gene, "its genome is not")])
def test_genomes_and_what_they_are_decoded_to(change: Edit, said: str, tmp_path: Path) -> None:
    run = made(tmp_path, MODULES)
    assert "genome" in json.loads((run.path / "best.json").read_text())
    assert verify(run.path).problems == []
    edit(run, change)
    (problem,) = verify(run.path).problems
    assert said in problem.message


def test_weights_that_cannot_be_decoded_here_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = made(tmp_path, MODULES)

    def refused(*_: object) -> None:
        raise InputError("not here")

    monkeypatch.setattr(Experiment, "representation", refused)
    found = verify(run.path)
    assert found.problems == []
    (said,) = found.not_compared
    assert said == "best.json: its weights, which cannot be decoded from the genome here: not here"
    assert swarmwright(["runs", "verify", str(run.path)]) == 0
    assert capsys.readouterr().out.startswith(f"{run.path}: not compared: {said}\n{run.path}: ok")
    edit(run, _gene)
    assert len(verify(run.path).problems) == 1


def test_a_genome_is_missed_where_it_is_not_the_weights(tmp_path: Path) -> None:
    run = made(tmp_path, MODULES)

    def change(values: dict[str, Any]) -> None:
        values["controller"]["weights"] = values.pop("genome")

    edit(run, change)
    (problem,) = verify(run.path).problems
    assert "has no genome" in problem.message


def test_another_candidate_than_the_best(tmp_path: Path) -> None:
    run = made(tmp_path, LAYERED)
    other = next(one for one in range(6) if (0, one) != (run.best.generation, run.best.candidate))
    evaluation = run.evaluation(other, 0)

    def change(values: dict[str, Any]) -> None:
        values.update(generation=0, candidate=other, fitness=evaluation.fitness)
        values["controller"]["weights"] = shortest(evaluation.genome)

    edit(run, change)
    (problem,) = verify(run.path).problems
    assert f"names candidate {other} of generation 0, but the best is candidate" in problem.message
    with closing(sqlite3.connect(run.path / "run.sqlite")) as store, store:
        store.execute("UPDATE session SET outcome = NULL")
    assert verify(run.path).problems == [], "a session that was killed leaves the file of an earlier one"


def test_a_missing_file_and_one_that_is_no_json(tmp_path: Path) -> None:
    run = made(tmp_path, LAYERED)
    (run.path / "best.json").write_text("{")
    (problem,) = verify(run.path).problems
    assert problem.message.startswith("best.json: is not valid JSON: ")
    (run.path / "best.json").unlink()
    assert verify(run.path).problems == []
