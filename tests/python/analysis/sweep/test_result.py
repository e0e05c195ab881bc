"""Sweeps in Python."""

import math
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import Experiment, InputError, Run, sweep
from swarmwright.runs.store import StoreWriter

BASE: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "parameters": {"maxSteps": 5},
    "method": {"kind": "nnga", "population": 6, "generations": 3},
}  # fmt: skip


@pytest.mark.slow
def test_a_mapping_becomes_runs_a_table_a_comparison_and_a_figure(tmp_path: Path) -> None:
    grid = {"method.kind": ["nnga", "random_search"], "method.population": (6, 8)}
    source = {
        "experiment": BASE,
        "grid": grid,
        "seeds": range(1, 3),
    }
    result = sweep(source, out=tmp_path / "out", jobs=1)
    assert (len(result.runs), result.failures, result.interrupted) == (8, (), False)
    rows = result.table()
    assert [(row["variant"], row["seed"]) for row in rows][:3] == [
        ("nnga, population 6", 1),
        ("nnga, population 8", 1),
        ("random_search, population 6", 1),
    ]
    assert [key for key in rows[0] if "." in key] == [
        "method.kind", "method.nnga.population", "method.random_search.population",
    ]  # fmt: skip
    assert [row["method.nnga.population"] for row in rows[:4]] == [6, 8, None, None]
    assert [(row["episodes"], math.isnan(row["held_out"])) for row in rows[:2]] == [
        (row["evaluations"], True) for row in rows[:2]
    ]
    assert all(row["fitness"] == Run.open(row["run"]).best.fitness for row in rows)
    assert len(result.compare().groups) == 4
    figure = result.plot(tmp_path / "figure.svg")
    assert (tmp_path / "figure.svg").exists()
    assert len(figure.axes) == 2
    assert repr(result) == f"<SweepResult {tmp_path / 'out'}: 8 runs>"
    assert result._repr_html_().count("<tr>") == 9
    # Once more nothing is computed, whoever is asked; other processes come to the same records.
    again = sweep({**source, "experiment": Experiment.from_mapping(BASE)}, out=tmp_path / "out")
    assert [run.sessions for run in again.runs] == [run.sessions for run in result.runs]
    others = sweep(source, out=tmp_path / "others", jobs=2)
    assert [run.digest for run in others.runs] == [run.digest for run in result.runs]


def test_a_damaged_run_does_not_stop_the_others(tmp_path: Path) -> None:
    source = {"experiment": BASE, "grid": {"method.population": [6]}, "seeds": [1, 2]}
    first, second = sweep(source, out=tmp_path / "out", jobs=1).runs
    (first.path / "run.sqlite").write_bytes(b"nothing" * 1000)
    third = {**source, "seeds": [1, 2, 3]}
    result = sweep(third, out=tmp_path / "out", jobs=1)
    assert [run.path.name for run in result.runs] == [second.path.name, second.path.name[:-1] + "3"]
    ((_, seed, message),) = [(one.variant, one.seed, one.message) for one in result.failures]
    assert seed == 1
    assert f"{first.path}/run.sqlite: is damaged" in message
    assert f"delete the folder {first.path} to repeat only this run in the same sweep" in message


def test_a_run_that_is_whole_is_not_to_be_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = {"experiment": BASE, "seeds": 1}
    sweep(source, out=tmp_path / "out", jobs=1)

    def missing(_: Run) -> bool:
        raise InputError("a plug-in is not installed")

    monkeypatch.setattr(Run, "validation_is_due", property(missing))
    (failure,) = sweep(source, out=tmp_path / "out", jobs=1).failures
    assert failure.message == "a plug-in is not installed"


def test_a_validation_that_was_interrupted_is_finished(tmp_path: Path) -> None:
    noisy = {
        **BASE,
        "parameters": {"placement": "random", "numAgents": 2},
        "validate": {"episodes": 30, "candidates": 2},
    }
    source = {"experiment": noisy, "grid": {"method.population": [6, 8]}, "seeds": 1}
    result = sweep(source, out=tmp_path / "out", jobs=1)
    first, other = result.runs
    assert first.unseen is not None
    assert result.table()[0]["held_out"] == first.unseen.fitness.mean
    whole = first._store.validation()
    assert whole is not None
    part = [
        {**one, "episodes": one["episodes"][:10], "values": one["values"][:10]} for one in whole["candidates"]
    ]
    with StoreWriter.resume(first.path) as store:
        store.note_validation({**whole, "state": "due", "candidates": part})
    assert Run.open(first.path).validation_is_due
    again = sweep(source, out=tmp_path / "out", jobs=1).runs
    assert again[0]._store.validation() == whole
    assert [len(run.sessions) for run in again] == [len(first.sessions) + 1, len(other.sessions)]


def test_finished_runs_are_validated_as_the_sweep_asks(tmp_path: Path) -> None:
    noisy = {**BASE, "parameters": {"placement": "random", "numAgents": 2}}

    def again(validate: Any) -> list[tuple[int, int]]:
        source = {"experiment": {**noisy, "validate": validate}, "seeds": 1}
        (run,) = sweep(source, out=tmp_path / "out", jobs=1).runs
        digests.add(run.digest)
        return [(0 if run.unseen is None else len(run.unseen.seeds), len(run.sessions))]

    digests: set[str] = set()
    assert again(False) == [(0, 1)]
    assert again({"episodes": 20, "candidates": 2}) == [(20, 2)]
    assert again({"episodes": 20, "candidates": 2}) == [(20, 2)]
    for fewer in (False, {"episodes": 10, "candidates": 2}, {"episodes": "auto"}):
        assert again(fewer) == [(20, 2)]
    assert again({"episodes": 30, "candidates": 2}) == [(30, 3)]
    assert again({"episodes": 30, "candidates": 3}) == [(30, 4)]
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("wanted", "episodes", "candidates"),
    [
        ({"episodes": 5, "candidates": 3}, 30, 3),
        ({"episodes": 40, "candidates": 1}, 40, 2),
        ({"episodes": 5, "candidates": 1, "seed": 77}, 30, 2),
        ({"episodes": 5, "candidates": 1}, 30, 2),
    ],
)
def test_a_validation_is_not_replaced_by_a_smaller_one(
    tmp_path: Path, wanted: dict[str, int], episodes: int, candidates: int
) -> None:
    noisy = {**BASE, "parameters": {"placement": "random", "numAgents": 2}}

    def again(validate: dict[str, int]) -> Run:
        source = {"experiment": {**noisy, "validate": validate}, "seeds": 1}
        (run,) = sweep(source, out=tmp_path / "out", jobs=1).runs
        return run

    again({"episodes": 30, "candidates": 2})
    run = again(wanted)
    validation = run.validation
    assert validation is not None
    assert (len(validation.best.seeds), len(validation.candidates)) == (episodes, candidates)
    if "seed" in wanted:
        assert validation.best.seeds[0] == wanted["seed"]
    assert len(again(wanted).sessions) == len(run.sessions), "nothing is left to do"


def test_a_file_is_taken_and_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Experiment.from_mapping(BASE).save("base.yaml")
    Path("few.yaml").write_text("experiment: base.yaml\ngrid: {method.population: [6]}\nseeds: 1\n")
    assert sweep("few.yaml").path == Path("runs/few")
    mapping = {"experiment": "base.yaml", "grid": {"method.population": [6]}, "seeds": 1}
    assert sweep(mapping).path == Path("runs/minisim-sweep")


@pytest.mark.slow
def test_failures_are_in_the_result(tmp_path: Path) -> None:
    grid = {"parameters.trouble": ["reset", ""]}
    experiment = {
        "simulation": "tests.python.simulations.troubled:Walk", "servers": "local",
        "method": {"population": 3, "generations": 1},
    }  # fmt: skip
    result = sweep({"experiment": experiment, "grid": grid, "seeds": 1}, out=tmp_path / "out", jobs=1)
    assert len(result.runs) == 1
    (failure,) = result.failures
    assert (failure.variant, failure.seed) == ("trouble reset", 1)
    assert "every candidate of generation 0 failed" in failure.message
    assert "trouble reset" in result._repr_html_()


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ({}, "experiment: must be an Experiment, a mapping"),
        ({"experiment": BASE, "grid": {}}, "grid: must be a mapping"),
        ({"experiment": BASE, "grids": {}}, "grids: unknown key; did you mean 'grid'"),
        ({"experiment": {"simulation": "minisim", "method": {"kind": "nnag"}}}, "nnga"),
        ({"experiment": "nowhere.yaml"}, "nowhere.yaml"),
    ],
)
def test_mistakes_are_named(source: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        swarmwright.sweep(source)
