"""Failed evaluations and episodes are counted, and no figure that leaves them out is recommended."""

import csv
import io
import json
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, compare, learning_curve, optimize, post_evaluate, resume
from swarmwright.cli import run as run_command
from swarmwright.methods.rankings.absolute import Absolute, AbsoluteOptions
from swarmwright.methods.rankings.multi_fidelity import MultiFidelity, MultiFidelityOptions
from swarmwright.methods.rankings.race import Race, RaceOptions
from swarmwright.runs.failures import count_failed_evaluations, iterate_episode_counts


def experiment(**ranking: Any) -> Experiment:
    """Return one of which most candidates fail: with nothing caught, the fitness has no value."""
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"numAgents": 4, "numDefenders": 2, "placement": "random"},
            "fitness": "1/caught",
            "method": {"kind": "snes", "evaluations": 200},
            "ranking": {"episodes": 3, **ranking},
            "servers": "local",
        }
    )


@pytest.fixture(scope="module")
def left_out(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(experiment(), out=tmp_path_factory.mktemp("last") / "run")


@pytest.fixture(scope="module")
def counted(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(experiment(failed=0), out=tmp_path_factory.mktemp("number") / "run")


def said(*arguments: str | Path) -> str:
    text = io.StringIO()
    with redirect_stdout(text):
        assert run_command(list(map(str, arguments))) == 0
    return text.getvalue()


def test_failures_of_a_run(left_out: Run) -> None:
    failed = np.isnan(left_out.record.episodes)
    assert left_out.failed_evaluations == np.count_nonzero(failed.any(axis=1)) == 167
    assert left_out.failed_episodes == np.count_nonzero(failed)
    assert count_failed_evaluations(left_out, 200) == 167
    some = int(failed[:50].any(axis=1).sum())  # in the middle of a generation
    assert count_failed_evaluations(left_out, 50) == some
    assert "167 of 200" in said("runs", "list", left_out.path.parent)
    shown = said("runs", "show", left_out.path)
    assert f"167 of 200 evaluations failed ({left_out.failed_episodes} failed episodes): they rank" in shown


def test_a_figure_that_leaves_failures_out_is_not_to_be_reported(left_out: Run) -> None:
    validation = left_out.validation
    assert validation is not None
    best = validation.best
    assert 0 < best.failed < len(best.episodes)
    assert validation.failed == sum(one.failed for one in validation.candidates)
    assert not best.is_reportable
    assert best.mean.mean == pytest.approx(np.nanmean(best.episodes))
    shown = said("runs", "show", left_out.path)
    assert "Report this one" not in shown
    assert f"of which {best.failed} failed" in shown
    assert "do not report this value" in shown
    values = json.loads(said("runs", "show", left_out.path, "--json"))
    assert values["unseen"]["reportable"] is False
    assert (values["failed"], values["failed_episodes"]) == (167, left_out.failed_episodes)


def test_a_number_is_the_fitness_of_a_failed_episode(counted: Run) -> None:
    record = counted.record
    failed = np.isnan(record.episodes)
    assert np.isfinite(record.fitness).all()
    np.testing.assert_allclose(record.fitness, np.where(failed, 0.0, record.episodes).mean(axis=1))
    assert counted.failed_evaluations == np.count_nonzero(failed.any(axis=1)) > 0
    assert counted.failed_episodes == np.count_nonzero(failed)
    best = counted.unseen
    assert best is not None
    assert best.failed
    assert best.is_reportable
    assert best.fitness.mean == pytest.approx(np.nan_to_num(best.episodes).mean())
    shown = said("runs", "show", counted.path)
    assert f"of which {best.failed} failed and count as 0" in shown
    assert "report this one" in shown.lower()
    assert "failed: 0" in (counted.path / "experiment.yaml").read_text()
    # The same in `evaluate`, which has the seeds of the validation.
    again = post_evaluate(counted, episodes=len(best.episodes))
    assert (again.fitness, again.failed) == (best.fitness, best.failed)


def test_a_run_without_a_number_is_evaluated_with_one(left_out: Run) -> None:
    assert left_out.unseen is not None
    count = len(left_out.unseen.episodes)
    setting = ("--episodes", str(count), "--set", "ranking.failed=0", "--json")
    values = json.loads(said("evaluate", left_out.path, *setting))
    assert (values["failed"], values["reportable"]) == (left_out.unseen.failed, True)
    assert values["mean"] == pytest.approx(np.nan_to_num(left_out.unseen.episodes).mean())
    without = said("evaluate", left_out.path, "--episodes", str(count))
    assert "do not report the mean of the others" in without


def test_a_resumed_run_counts_the_same(counted: Run, tmp_path: Path) -> None:
    begun = optimize(experiment(failed=0), lambda one: one.generation < 3, out=tmp_path / "run")
    assert begun.generations < counted.generations
    reported = []
    again = resume(begun, lambda one: reported.append(one.failed_so_far))
    assert again.digest == counted.digest
    assert reported[-1] == again.failed_evaluations == counted.failed_evaluations


def test_comparisons_count_failures(left_out: Run, counted: Run, tmp_path: Path) -> None:
    recorded = compare([left_out])
    assert recorded.groups[0].failed == (167,)
    assert "evaluations failed (minisim, snes: 83.5 %)" in str(recorded)
    held_out = compare([left_out], held_out=True)
    assert left_out.unseen is not None
    lost = left_out.unseen.failed
    assert held_out.groups[0].held_out_failed == (lost,)
    assert f"minisim, snes: {lost} in 1 of 1 runs): do not report these means" in str(held_out)
    (of_run,) = held_out.to_mapping()["groups"][0]["runs"]
    assert (of_run["failed"], of_run["held_out_failed"]) == (167, lost)
    table = held_out.export(tmp_path / "table.csv").read_text(encoding="utf-8")
    (row,) = csv.DictReader(table.splitlines())
    assert (row["failed"], row["held_out_failed"]) == ("167", str(lost))
    assert "held-out failed" in held_out.export(tmp_path / "table.tex").read_text(encoding="utf-8")
    curve = learning_curve(left_out, points=1, episodes=30)
    assert not curve.is_reportable
    (point,) = csv.DictReader(curve.export(tmp_path / "curve.csv").read_text(encoding="utf-8").splitlines())
    assert point["failed"] == str(lost)
    assert "which exclude failed episodes" in said(
        "evaluate", left_out.path, "--curve", "1", "--episodes", "30"
    )
    # With a number, nothing is left out; and it is another quantity than without one.
    assert "do not report" not in str(compare([counted], held_out=True))
    both = compare([left_out, counted], held_out=True)
    assert len(both.tasks) == 2
    assert not both.pairs


def test_a_race_counts_failures_but_not_what_it_leaves_out(tmp_path: Path) -> None:
    given = replace(experiment(), ranking=RaceOptions(episodes=8, first_test=4, failed=0.0))
    run = optimize(given, out=tmp_path / "run")
    found = list(iterate_episode_counts(run))
    lengths = np.concatenate([one.episodes for one in found])
    without = np.isnan(run.record.episodes)
    assert (lengths < 8).any()
    assert run.episodes_saved == (8 - lengths).sum()
    through = np.arange(8) < lengths[:, np.newaxis]
    assert run.failed_episodes == np.count_nonzero(without & through) > 0
    assert not np.isfinite(run.record.episodes[~through]).any()
    assert compare([run]).groups[0].episodes == (int(lengths.sum()),)


def test_rankings_with_a_fitness_of_failed_episodes() -> None:
    episodes = np.array([[1.0, np.nan], [np.nan, np.nan], [3.0, 4.0], [np.inf, 2.0]])
    assert Absolute(AbsoluteOptions(failed=-5.0)).score(episodes).tolist() == [-2.0, -5.0, 3.5, -1.5]
    worst = Absolute(AbsoluteOptions(failed=-5, aggregate="worst", episodes=2))
    assert worst.score(episodes).tolist() == [-5.0, -5.0, 3.0, -5.0]
    race = Race(RaceOptions(episodes=3, first_test=2, failed=-1))
    assert np.isfinite(race.score(np.array([[1.0, np.nan, 1.0], [1.0, 1.0, 1.0]]))).all()
    slow = MultiFidelity(MultiFidelityOptions(slow="other", share=0.5, failed=-7))
    fast = np.array([[1.0], [0.0], [np.nan], [-9.0]])
    there = np.array([[np.nan], [5.0], [np.nan], [np.nan]])
    metrics = np.empty((4, 1, 0))
    assert slow.find_transferred(fast, there, metrics).tolist() == [True, True, False, False]
    assert slow.rank(fast, there, metrics)[:2].tolist() == [-7.0, 5.0]
    one = Absolute(AbsoluteOptions(reevaluate=True, failed=-1))
    genomes = np.zeros((1, 1), np.float32)
    assert one.score(np.array([[np.nan]]), genomes).tolist() == [-1.0]
    assert one.score(np.array([[3.0]]), genomes).tolist() == [1.0]


@pytest.mark.parametrize("value", ["lasst", "1", True, None, float("inf"), float("nan"), 10**400, [1]])
def test_what_failed_may_not_be(value: Any) -> None:
    with pytest.raises(InputError, match=r"^ranking\.failed: must be last, stop or the fitness of a failed"):
        experiment(failed=value)


def test_methods_that_compare_metrics_refuse_a_number() -> None:
    values = experiment().to_mapping()
    values["ranking"]["failed"] = 0
    values["method"] = {"kind": "nsga2", "objectives": {"steps": "maximize"}}
    with pytest.raises(InputError, match=r"ranking\.failed: nsga2 also compares metrics \(steps\)"):
        Experiment.from_mapping(values)


@pytest.mark.slow
def test_short_runs_say_that_they_are_not_validated(tmp_path: Path) -> None:
    file = tmp_path / "short.yaml"
    file.write_text(
        "simulation: minisim\nparameters: {placement: random}\nmethod: {kind: snes, generations: 2}\n"
    )
    out = tmp_path / "run"
    text = said("optimize", file, "--out", out)
    command = f"swarmwright resume {out} --set validate.episodes=100"
    assert "Not validated on held-out seeds: 5% of the run's evaluations are" in text
    assert command in text
    assert command in said("runs", "show", out)
    assert "Report this one" in said(*command.split()[1:])
    assert "ot validated" not in said("runs", "show", out)
    switched_off = said("optimize", file, "--out", tmp_path / "off", "--set", "validate=false")
    assert "Not validated" not in switched_off
