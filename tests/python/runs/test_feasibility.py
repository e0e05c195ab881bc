"""Runs with constraints: the record, the best candidate, resumption, and what is said about them."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from swarmwright import Experiment, Generation, InputError, Run, optimize, resume
from swarmwright.cli._main import run as command
from tests.python.methods.needed import method_of
from tests.python.records import same_record

VALUES: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
    "constraints": {"caught": {"at_most": 1}, "distance": {"at_most": 9.5}},
    "method": {"kind": "nnga", "population": 20, "generations": 8},
    "ranking": {"episodes": 4},
    "servers": "in-process",
    "seed": 5,
}
EXPERIMENT = Experiment.from_mapping(VALUES)
METHODS: list[dict[str, Any]] = [
    {"kind": "nnga"},
    {"kind": "snes"},
    {"kind": "de"},
    {"kind": "nsga2", "objectives": {"steps": "minimize"}},
    {"kind": "map_elites", "measures": {"steps": {"range": [0, 15], "bins": 5}}},
    {"kind": "novelty"},
    {"kind": "cea2d", "width": 5, "height": 4, "operation": "steady_state", "in_flight": 4},
]


def check_record(run: Run) -> None:
    """Fitness, violations and the best agree with episodes and metrics."""
    record, constraints = run.record, run.experiment.constraints
    columns = [run.metrics.index(name) for name in constraints]
    means = record.metrics[:, :, columns].mean(axis=1)
    limits = [constraints[name] for name in constraints]
    feasible = np.logical_and.reduce(
        [limit.meets(column) for limit, column in zip(limits, means.T, strict=True)]
    )
    assert 0 < feasible.sum() < len(feasible)
    assert ((run.violations == 0) == feasible).all()
    assert np.isnan(record.fitness[~feasible]).all()
    assert record.fitness[feasible] == pytest.approx(record.episodes[feasible].mean(axis=1))
    best = run.evaluation()
    assert best.fitness == record.fitness[feasible].max()
    assert run.failed_evaluations == 0
    so_far = math.nan
    for summary in run.history:
        now = record.fitness[: summary.evaluations]
        so_far = np.nan if np.isnan(now).all() else float(np.nanmax(now))
        assert summary.best_so_far == pytest.approx(so_far, nan_ok=True)
        leader = run._store.leader(summary.generation).number
        if math.isnan(so_far):
            assert run.violations[leader] == run.violations[: summary.evaluations].min()
        else:
            assert record.fitness[leader] == so_far


@pytest.mark.parametrize("options", METHODS, ids=lambda options: options["kind"])
def test_the_best_is_feasible_and_a_resumed_run_has_the_same_bytes(
    options: dict[str, Any], tmp_path: Path
) -> None:
    size = {} if "width" in options else {"population": 20}
    method = method_of(**{**options, **size, "generations": 8})
    experiment = EXPERIMENT.replace(method=method)
    whole = optimize(experiment, out=tmp_path / "whole")
    check_record(whole)

    def until_four(now: Generation) -> bool:
        return now.generation < 3

    part = optimize(experiment, until_four, out=tmp_path / "part")
    assert part.generations == 4
    run = resume(part)
    same_record(run, whole)
    assert run.best == whole.best


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 2, 8])
def test_servers_do_not_matter(servers: int, tmp_path: Path) -> None:
    whole = optimize(EXPERIMENT, out=tmp_path / "whole")
    same_record(optimize(EXPERIMENT, servers=servers, out=tmp_path / "run"), whole)


def test_without_a_feasible_candidate_the_best_has_the_smallest_violation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = {**VALUES, "constraints": {"steps": {"at_most": 1}}}
    for kind, options in (("nnga", {}), ("nsga2", {"objectives": {"caught": "minimize"}})):
        experiment = Experiment.from_mapping(
            {**values, "method": {"kind": kind, "population": 10, "generations": 4, **options}}
        )
        run = optimize(experiment, out=tmp_path / kind)
        assert np.isnan(run.fitness).all()
        assert run.violations[run.evaluation().number] == run.violations.min()
        assert math.isnan(run.best.fitness)
        assert all(math.isnan(summary.best_so_far) for summary in run.history)
        last = run.evaluation(generation=3)
        assert (
            run.violations[last.number] == run.violations[-len(run.violations) // 4 :].min() or kind == "nnga"
        )
        assert command(["runs", "show", str(run.path)]) == 0
        shown = capsys.readouterr().out
        assert "0 of" in shown
        assert "no candidate meets all constraints" in shown
        assert "best without fitness" in shown
        assert command(["runs", "show", str(run.path), "--json"]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["best"]["fitness"] is None
        assert facts["constraints"] == {"feasible": 0, "violation": run.violations.min()}


def test_commands_report_constraints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(yaml.safe_dump(VALUES))
    assert command(["optimize", str(file), "--out", str(tmp_path / "run")]) == 0
    output = capsys.readouterr().out
    run = Run(tmp_path / "run")
    feasible = int(np.isfinite(run.fitness).sum())
    limits = "caught at most 1, distance at most 9.5"
    assert f"{feasible} of {run.evaluations} candidates meet the constraints ({limits})." in output
    assert Experiment.load(tmp_path / "run" / "experiment.yaml") == run.experiment
    assert command(["runs", "list", str(tmp_path)]) == 0
    assert f"{run.best.fitness:.6g}" in capsys.readouterr().out


def test_a_validation_says_whether_the_constraints_hold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = optimize(EXPERIMENT.replace(validate={"episodes": 40, "candidates": 3}), out=tmp_path / "run")
    validation = run.validation
    assert validation is not None
    violations = [validation.violation_of(candidate) for candidate in validation.candidates]
    caught, distance = (
        [candidate.metrics[name].mean() for candidate in validation.candidates]
        for name in ("caught", "distance")
    )
    expected = [
        max(0, one - 1) + max(0, other / 9.5 - 1) for one, other in zip(caught, distance, strict=True)
    ]
    assert violations == pytest.approx(expected)
    assert [entry["violation"] for entry in validation.to_mapping()["candidates"]] == violations
    assert validation.violation_of(validation.leading) == min(violations)
    assert command(["runs", "show", str(run.path)]) == 0
    assert ("violates a constraint on these seeds" in capsys.readouterr().out) == (violations[0] > 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"constraints": {"caughd": {"at_most": 0}}}, "constraints.caughd: .*did you mean 'caught'"),
        ({"constraints": {"caught": {}}}, "constraints.caught: needs at_least, at_most or both"),
        ({"constraints": {"caught": {"at_most": 0, "at_least": 1}}}, "at_least 1 is above at_most 0"),
        ({"constraints": {"caught": {"most": 0}}}, "constraints.caught.most: unknown key"),
        ({"constraints": {"caught": {"at_most": math.inf}}}, "finite"),
        ({"constraints": [1]}, "constraints: must be a mapping"),
        ({"ranking": {"kind": "race", "episodes": 10}}, "constraints: .*ranking.kind: race"),
        ({"ranking": {"reevaluate": True}}, "constraints: .*ranking.reevaluate"),
        ({"ranking": {"failed": -100}}, "ranking.failed: constraints compare metrics"),
        ({"method": {"kind": "racing"}}, "constraints: are not possible with racing"),
        ({"simulation": "emergency_exit", "parameters": {}}, "constraints.caught: "),
    ],
)
def test_mistakes_are_reported(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Experiment.from_mapping({**VALUES, **changes})


def test_an_experiment_with_constraints_is_written_and_compared() -> None:
    assert Experiment.from_mapping(EXPERIMENT.to_mapping()) == EXPERIMENT
    other = EXPERIMENT.replace(constraints={"caught": {"at_most": 2}})
    assert other != EXPERIMENT
    assert hash(other) != hash(EXPERIMENT)
    assert other.constraints["distance"] == EXPERIMENT.constraints["distance"]
    assert "constraints" not in EXPERIMENT.replace(constraints=None).to_mapping()
    assert EXPERIMENT.with_settings(["constraints.caught.at_most=2"]) == other
