"""Sweeps that are given again with more seeds, variants or larger limits."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, SweepResult, sweep
from tests.python.records import same_record

BASE: dict[str, Any] = {
    "simulation": "minisim", "servers": "in-process", "parameters": {"maxSteps": 5, "placement": "random"},
    "method": {"kind": "nnga", "population": 6, "generations": 3}, "validate": False,
}  # fmt: skip


def with_method(**options: Any) -> Experiment:
    return Experiment.from_mapping({**BASE, "method": {"kind": "nnga", "population": 6, **options}})


def same(found: SweepResult, whole: SweepResult) -> None:
    """Check that two sweeps have the same runs."""
    assert (found.failures, found.left_out) == ((), ())
    for one, other in zip(found.runs, whole.runs, strict=True):
        same_record(one, other)
        assert one.experiment == other.experiment


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"generations": 3}, {"generations": 6}),
        ({"evaluations": 14}, {"evaluations": 40}),
        ({"generations": 3}, {"evaluations": 40}),
        ({"evaluations": 14}, {"generations": 6}),
        ({"generations": 3, "evaluations": 1000}, {"generations": 6}),
        ({"seconds": 1e-6}, {"generations": 6}),
        ({"evaluations": 20}, {"evaluations": 21}),  # not enough for another generation
        ({"generations": 6, "target": -99.0}, {"generations": 9, "target": -99.0}),  # it is reached
    ],
)
def test_finished_runs_go_on_to_larger_limits(
    before: dict[str, Any], after: dict[str, Any], tmp_path: Path
) -> None:
    grid = {"controller.hidden": [[2], [3]]}
    first = sweep(with_method(**before), grid, seeds=1, out=tmp_path / "out", jobs=1)
    assert (len(first.runs), first.failures) == (2, ())
    longer = sweep(with_method(**after), grid, seeds=2, out=tmp_path / "out", jobs=1)
    same(longer, sweep(with_method(**after), grid, seeds=2, out=tmp_path / "whole", jobs=1))
    assert [len(group.runs) for group in longer.compare().groups] == [2, 2]
    again = sweep(with_method(**after), grid, seeds=2, out=tmp_path / "out", jobs=1)
    assert [run.sessions for run in again.runs] == [run.sessions for run in longer.runs]


def test_a_longer_run_is_validated_anew(tmp_path: Path) -> None:
    validated = {**BASE, "validate": {"episodes": 10}}
    (first,) = sweep(validated, seeds=1, out=tmp_path / "out").runs
    longer = {**validated, "method": {**BASE["method"], "generations": 6}}
    (run,) = sweep(longer, seeds=1, out=tmp_path / "out").runs
    (whole,) = sweep(longer, seeds=1, out=tmp_path / "whole").runs
    assert run.unseen is not None
    assert whole.unseen is not None
    assert run.unseen.fitness.mean == whole.unseen.fitness.mean
    assert first.generations == 3


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ({"generations": 3}, {"generations": 2}, "2 is less than the experiment's 3"),
        ({"evaluations": 20}, {"generations": 1}, "1 is less than the 5 of the run"),
        (
            {"generations": 3},
            {"generations": 6, "severity": 0.5},
            "holds a run of another experiment: method.severity",
        ),
    ],
)
def test_what_is_no_larger_budget_is_refused(
    before: dict[str, Any], after: dict[str, Any], words: str, tmp_path: Path
) -> None:
    (run,) = sweep(with_method(**before), seeds=1, out=tmp_path / "out").runs
    with pytest.raises(InputError, match=words) as caught:
        sweep(with_method(**after), seeds=1, out=tmp_path / "out")
    assert str(caught.value).endswith("choose another folder for the results (out)")
    assert Run.open(run.path).experiment == run.experiment


FILE = """\
experiment: base.yaml
grid: {method.generations: LIMITS, method.population: [4, 6]}
seeds: SEEDS
out: OUT
"""


def by_file(folder: Path, limits: str, *, seeds: int = 1, name: str = "sweep.yaml") -> SweepResult:
    Experiment.from_mapping(BASE).save(folder / "base.yaml")
    text = FILE.replace("LIMITS", limits).replace("SEEDS", str(seeds)).replace("OUT", str(folder / "out"))
    (folder / name).write_text(text)
    return sweep(folder / name, jobs=1)


def test_limits_of_the_grid_are_raised(tmp_path: Path) -> None:
    first = by_file(tmp_path, "[2]")
    longer = by_file(tmp_path, "[3]", seeds=2)
    assert [run.path for run in longer.runs[:2]] == [run.path for run in first.runs]
    assert [run.generations for run in longer.runs] == [3, 3, 3, 3]
    by_record = sweep(tmp_path / "out" / "sweep.json", jobs=1)
    assert [run.sessions for run in by_record.runs] == [run.sessions for run in longer.runs]
    # A further value is a further variant, and the others stay.
    both = by_file(tmp_path, "[3, 4]", seeds=2)
    assert [run.generations for run in both.runs] == [3, 3, 4, 4] * 2
    assert {run.path for run in longer.runs} < {run.path for run in both.runs}
    # A smaller one is another variant, too.
    assert [run.generations for run in by_file(tmp_path, "[1]").runs] == [1, 1]


def test_runs_of_another_sweep_in_the_folder_are_left_alone(tmp_path: Path) -> None:
    first = by_file(tmp_path, "[2]")
    other = by_file(tmp_path, "[3]", name="other.yaml")
    assert not {run.path for run in first.runs} & {run.path for run in other.runs}
    assert [Run.open(run.path).generations for run in first.runs] == [2, 2]


def test_a_record_completes_a_sweep_that_was_interrupted_while_it_was_extended(tmp_path: Path) -> None:
    first = by_file(tmp_path, "[2]")
    record = tmp_path / "out" / "sweep.json"
    record.write_text(record.read_text().replace('"generations": 2', '"generations": 3'))
    longer = sweep(record, jobs=1)
    assert [(run.path, run.generations) for run in longer.runs] == [(run.path, 3) for run in first.runs]


def test_an_experiment_and_a_grid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = Experiment.from_mapping(BASE)
    grids: list[dict[str, Any]] = [{"method.population": [4]}, {"method.population": range(5, 7)}]
    found = sweep(experiment, grids, seeds=[3], jobs=1)
    assert found.path == Path("runs/minisim-sweep")
    assert [
        (run.experiment.to_mapping()["method"]["population"], run.experiment.seed) for run in found.runs
    ] == [
        (4, 3),
        (5, 3),
        (6, 3),
    ]
    alone = sweep(experiment, seeds=1, out="alone")
    assert [run.experiment for run in alone.runs] == [experiment]
    experiment.save("base.yaml")
    for source in (BASE, "base.yaml"):
        again = sweep(source, grids, seeds=[3], jobs=1)
        assert [run.sessions for run in again.runs] == [run.sessions for run in found.runs]


@pytest.mark.parametrize(
    ("source", "given", "words"),
    [
        ({"experiment": BASE}, {"grid": {"method.population": [4]}}, "grid: is only for an experiment"),
        ({"experiment": BASE}, {"seeds": 3}, "seeds: is only for an experiment"),
        (BASE, {"grid": {"method.populatoin": [4]}}, "did you mean 'population'"),
        (BASE, {"grid": 3}, "grid"),
        (BASE, {"seeds": 0}, "seeds: must be a number of seeds"),
        (BASE, {"seeds": "many"}, "seeds"),
    ],
)
def test_mistakes_are_named(source: Any, given: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        sweep(source, out=tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()
