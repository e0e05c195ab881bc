"""Evolution that starts from controllers that are there already."""

# ruff: noqa: E501 - a table of messages, a line each

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.experiment.opponents import genomes_of
from swarmwright.methods import METHODS

VALUES: dict[str, Any] = {
    "simulation": "minisim",
    "method": {"kind": "nnga", "population": 12, "generations": 3},
    "servers": "local",
}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(Experiment.from_mapping(VALUES), out=tmp_path_factory.mktemp("runs") / "first")


def experiment(**changes: Any) -> Experiment:
    return Experiment.from_mapping(VALUES).replace(**changes)


@pytest.mark.parametrize("where", ["folder", "file", "candidate"])
def test_the_first_candidate_is_the_given_one(where: str, first: Run, tmp_path: Path) -> None:
    given = {
        "folder": str(first.path),
        "file": str(first.path / "best.json"),
        "candidate": {"run": str(first.path), "generation": 0, "candidate": 3},
    }[where]
    run = optimize(experiment(start_from=given, seed=2), out=tmp_path / "run")
    expected = first.evaluation(3, 0) if where == "candidate" else first.evaluation()
    assert run.record.genomes[0].tobytes() == expected.genome.tobytes()
    assert run.record.fitness[0] == expected.fitness
    usual = optimize(experiment(seed=2), out=tmp_path / "usual").record.genomes
    assert run.record.genomes[1:12].tobytes() == usual[1:12].tobytes(), "the others are as ever"


def test_paths_of_other_classes(first: Run) -> None:
    class Other:
        def __fspath__(self) -> str:
            return str(first.path)

    for given in (Other(), {"run": Other()}, first.path, [Other()]):
        assert experiment(start_from=given).start_from == experiment(start_from=str(first.path)).start_from


def test_several_take_the_first_places(first: Run, tmp_path: Path) -> None:
    given = [{"run": str(first.path), "generation": 0, "candidate": 3}, str(first.path / "best.json")]
    run = optimize(experiment(start_from=given), out=tmp_path / "run")
    assert run.record.genomes[0].tobytes() == first.evaluation(3, 0).genome.tobytes()
    assert run.record.genomes[1].tobytes() == first.evaluation().genome.tobytes()


def test_the_run_needs_the_other_one_no_more(first: Run, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(first.path, copy)
    file = tmp_path / "my.yaml"
    file.write_text(
        "simulation: minisim\nmethod: {population: 12, generations: 2}\nservers: local\nstart_from: copy\n"
    )
    run = optimize(file, out=tmp_path / "run")
    shutil.rmtree(copy)
    again = optimize(run.path / "experiment.yaml", out=tmp_path / "again")
    assert again.digest == run.digest
    longer = resume(run, generations=3)
    assert (
        longer.digest
        == optimize(run.experiment.replace(method={"generations": 3}), out=tmp_path / "l").digest
    )
    assert Run.open(run.path).experiment.start_from == run.experiment.start_from


@pytest.mark.parametrize("kind", ["cma_es", "openai_es", "pgpe", "sep_cma_es", "snes", "xnes"])
def test_distributions_start_there(kind: str, first: Run) -> None:
    method = {"kind": kind, "population": 40}
    genome = first.evaluation().genome
    changed = experiment(start_from=str(first.path), method=method)
    asked = changed.new_method(changed.representation()).ask()
    assert np.abs(asked.mean(axis=0) - genome).mean() < 0.5
    with pytest.raises(InputError, match=f"start_from: {kind} starts from one controller"):
        experiment(start_from=[str(first.path), str(first.path)], method=method)


def test_in_steady_state_too(first: Run, tmp_path: Path) -> None:
    steady = experiment(start_from=str(first.path), method={"operation": "steady_state"}, seed=2)
    run = optimize(steady, out=tmp_path / "run")
    assert run.record.genomes[0].tobytes() == first.evaluation().genome.tobytes()


def test_genes_that_are_not_weights_are_kept_too(tmp_path: Path) -> None:
    tuned = {
        "simulation": "minisim",
        "parameters": {"steering": "rule"},
        "controller": {
            "kind": "parameter_set",
            "parameters": {"maxSteps": {"type": "integer", "range": [5, 20]}},
        },
        "method": {"population": 12, "generations": 2},
        "servers": "local",
    }
    run = optimize(Experiment.from_mapping(tuned), out=tmp_path / "run")
    next_one = Experiment.from_mapping({**tuned, "start_from": str(run.path), "seed": 5})
    assert (
        optimize(next_one, out=tmp_path / "next").record.genomes[0].tobytes()
        == run.evaluation().genome.tobytes()
    )
    own = Experiment.from_mapping({**tuned, "start_from": str(run.path / "best.json"), "seed": 5})
    assert own.start_from is not None
    assert own.start_from[0]["genome"] == next_one.start_from[0]["genome"]  # type: ignore[index]
    run.best.controller.save(tmp_path / "without.json")
    with pytest.raises(InputError, match="but not its genome; use the folder of its run"):
        Experiment.from_mapping({**tuned, "start_from": str(tmp_path / "without.json")})
    wider = {"kind": "parameter_set", "parameters": {"maxSteps": {"type": "integer", "range": [5, 400]}}}
    for start in (run.path, run.path / "best.json"):
        with pytest.raises(InputError, match="its genome and values do not match"):
            Experiment.from_mapping({**tuned, "controller": wider, "start_from": str(start)})


KINDS: dict[str, dict[str, Any]] = {
    "machine": {
        "simulation": "arena",
        "parameters": {"mission": "aac", "robot": "e-puck-rm1.2", "robots": 2, "duration": 2},
        "controller": {"kind": "modules"},
    },
    "parameters": {
        "simulation": "minisim",
        "parameters": {"steering": "rule"},
        "controller": {
            "kind": "parameter_set",
            "parameters": {"maxSteps": {"type": "integer", "scale": "log", "range": [5, 20]}},
        },
    },
    "network": {"simulation": "minisim"},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_the_best_of_any_kind_can_be_started_from(name: str, tmp_path: Path) -> None:
    values = {
        **KINDS[name], "method": {"kind": "racing", "evaluations": 200}, "servers": "in-process", "seed": 2,
    }  # fmt: skip
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    file = run.path / "best.json"
    assert ("genome" in json.loads(file.read_text())) == (name != "network")
    again = Experiment.from_mapping({**values, "start_from": str(file)})
    assert again.start_from is not None
    (genome,) = genomes_of(again.start_from, again.representation())
    assert genome.tobytes() == run.evaluation().genome.tobytes()
    two = optimize(Experiment.from_mapping(values), servers=2, out=tmp_path / "two")
    assert (two.path / "best.json").read_bytes() == file.read_bytes()


@pytest.mark.parametrize("genome", ["x", None, 5, [1, 2], ["a"], {"a": 1}, [[1]], [float("nan")]])
def test_a_file_may_hold_any_genome(genome: object, tmp_path: Path) -> None:
    run = optimize(
        Experiment.from_mapping(
            {**KINDS["parameters"], "servers": "in-process", "method": {"population": 9, "generations": 1}}
        ),
        out=tmp_path / "run",
    )
    file = tmp_path / "changed.json"
    file.write_text(json.dumps({**json.loads((run.path / "best.json").read_text()), "genome": genome}))
    with pytest.raises(InputError, match=r"changed\.json: "):
        run.experiment.replace(start_from=str(file))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"controller": {"hidden": [4]}}, "is layered, 4-8-1, tanh, but controllers of this experiment are layered, 4-4-1, tanh; they differ in hidden \\(\\[8\\], here \\[4\\]; set controller.hidden\\)"),
        ({"controller": {"output_range": [0, 1]}}, "they differ in output_range \\(\\[-1.0, 1.0\\], here \\[0.0, 1.0\\]; set controller.output_range\\)"),
        ({"controller": {"kind": "fully_meshed"}}, "controllers of this experiment are fully_meshed"),
        ({"start_from": "nowhere"}, "start_from: .*nowhere: file not found"),
        ({"start_from": 5}, "must be the path of a run or of a controller"),
        ({"start_from": {"run": "x", "candidat": 3}}, "a mapping must have the form"),
        ({"method": {"population": 10}, "start_from": 12}, "12 controllers exceed the 10"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_said_before_the_run(changes: dict[str, Any], words: str, first: Run) -> None:
    given = changes.pop("start_from", str(first.path))
    if given == 12:
        given = [str(first.path)] * 12
    with pytest.raises(InputError, match=words):
        experiment(start_from=given, **changes)


def test_a_method_that_cannot_says_so(first: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(METHODS.get("nnga"), "start_as", None)
    with pytest.raises(InputError, match="start_from: nnga cannot start from given controllers"):
        experiment(start_from=str(first.path))


def test_a_torus_has_a_cell_for_each_controller(first: Run, tmp_path: Path) -> None:
    torus = {"kind": "cea2d", "width": 2, "height": 2, "generations": 3}
    words = "start_from: 6 controllers exceed the 4 candidates of the first generation"
    with pytest.raises(InputError, match=words):
        experiment(method=torus, start_from=[str(first.path)] * 6)
    fits = experiment(method=torus, start_from=[str(first.path)] * 4)
    assert optimize(fits, out=tmp_path / "fits").generations == 3
