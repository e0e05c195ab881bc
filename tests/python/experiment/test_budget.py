"""Budgets by evaluations and by time, besides generations."""

import logging
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from swarmwright import Experiment, Generation, InputError, Run, optimize, resume
from swarmwright.cli._commands import program
from swarmwright.experiment.budget import Budget

QUICK: dict[str, Any] = {
    "simulation": "minisim",
    "method": {"kind": "nnga", "population": 20},
    "servers": "local",
}
STEADY = {"operation": "steady_state", "in_flight": 8}


def experiment(**method: Any) -> Experiment:
    return Experiment.from_mapping({**QUICK, "method": {**QUICK["method"], **method}})


def prefix(run: Run, other: Run) -> bool:
    """Whether the record of a run is the beginning of another one's."""
    count = run.evaluations
    one, two = run.record, other.record
    return bool(
        count
        and one.genomes.tobytes() == two.genomes[:count].tobytes()
        and one.fitness.tobytes() == two.fitness[:count].tobytes()
        and one.generation.tolist() == two.generation[:count].tolist()
    )


def test_another_budget_takes_the_place_of_the_default_generations() -> None:
    assert experiment().budget == Budget(200, None, None)
    only = experiment(evaluations=1000)
    assert only.budget == Budget(None, 1000, None)
    assert "generations" not in only.to_mapping()["method"]
    assert Experiment.from_mapping(only.to_mapping()) == only
    assert only.replace(method={"evaluations": None}).budget == Budget(200, None, None)
    assert experiment(seconds=5.0, generations=7).budget == Budget(7, None, 5.0)


def test_a_limit_that_is_given_takes_the_place_of_all_limits() -> None:
    for old in (experiment(generations=10), experiment(), experiment(generations=10, seconds=5.0)):
        assert old.replace(method={"evaluations": 2000}).budget == Budget(None, 2000, None)
        assert old.with_settings(["method.evaluations=2000"]).budget == Budget(None, 2000, None)
    limited = experiment(evaluations=900, seconds=5.0)
    assert limited.replace(method={"generations": 3, "seconds": 1.0}).budget == Budget(3, None, 1.0)
    assert limited.replace(method={"population": 30}).budget == limited.budget
    kept = limited.with_settings(["method.evaluations=1000"], only=("method",))
    assert kept.budget == Budget(None, 1000, 5.0), "a run that goes on"


@pytest.mark.parametrize("changes", [{}, {"kind": "cma_es"}, {"kind": "pso"}, STEADY])
def test_it_ends_before_there_would_be_more_evaluations(changes: dict[str, Any], tmp_path: Path) -> None:
    run = optimize(experiment(evaluations=150, **changes), out=tmp_path / "run")
    longer = optimize(experiment(evaluations=400, **changes), out=tmp_path / "longer")
    assert 110 <= run.evaluations <= 150
    assert 360 <= longer.evaluations <= 400
    assert run.ended == longer.ended == "evaluations"
    assert run.state == "done"
    assert prefix(run, longer)
    assert resume(run, evaluations=400).digest == longer.digest


def test_members_that_are_evaluated_again_count(tmp_path: Path) -> None:
    noisy = experiment(evaluations=100).replace(ranking={"reevaluate": True, "seeds": "new"})
    run = optimize(noisy, out=tmp_path / "run")
    assert run.evaluations == 100, "20 in each of five generations, 15 of them new"
    assert run.generations == 5
    shown = CliRunner().invoke(program, ["runs", "show", str(run.path)]).output
    assert "ended because all 100 evaluations are used" in shown


def test_the_first_generation_is_evaluated_in_any_case(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        run = optimize(experiment(evaluations=7), out=tmp_path / "run")
    assert (run.evaluations, run.ended) == (20, "evaluations")
    assert "method.evaluations: 7 is less than the first generation" in caplog.text
    shown = CliRunner().invoke(program, ["runs", "show", str(run.path)]).output
    assert "ended because the first generation has used 20 evaluations, more than 7" in shown
    steady = optimize(experiment(evaluations=7, **STEADY), out=tmp_path / "steady")
    assert (steady.evaluations, steady.ended) == (20, "evaluations")


@pytest.mark.parametrize("changes", [{}, STEADY])
def test_time_ends_it_at_the_end_of_a_generation(changes: dict[str, Any], tmp_path: Path) -> None:
    whole = optimize(experiment(seconds=0.2, **changes), out=tmp_path / "run")
    assert (whole.state, whole.ended) == ("done", "seconds")
    assert whole.seconds < 15
    unlimited = optimize(experiment(generations=whole.generations + 2, **changes), out=tmp_path / "unlimited")
    assert prefix(whole, unlimited)
    assert resume(whole).generations == whole.generations, "its time is over"


def test_what_is_left_of_the_time_is_what_earlier_sessions_did_not_use(tmp_path: Path) -> None:
    def stop(generation: Generation) -> bool:
        return generation.seconds < 0.4

    run = optimize(experiment(seconds=0.8), stop, out=tmp_path / "run")
    assert run.state == "stopped"
    first = run.seconds
    seen: list[Generation] = []
    run = resume(run, seen.append)
    assert run.ended == "seconds"
    assert seen[-1].budget == "seconds"
    # Half of it without the first session; the clock is read again a moment after this report.
    assert seen[-1].share > 0.9
    # The last generation but one began within the time.
    assert first + seen[-2].seconds < 0.8


def test_larger_populations_use_up_the_budget_in_fewer_generations(tmp_path: Path) -> None:
    method = {"kind": "snes", "population": 20, "generations": 300, "restart": "ipop"}
    run = optimize(Experiment.from_mapping({**QUICK, "method": method}), out=tmp_path / "run")
    assert run.generations < 300
    assert 300 * 20 * 0.8 < run.evaluations <= 300 * 20
    assert run.ended == "generations"
    shown = CliRunner().invoke(program, ["runs", "show", str(run.path)]).output
    assert (
        f"ended because the evaluations are used after {run.generations} of 300 generations, as "
        "restarts have enlarged the population; method.restart: none runs all 300\n"
    ) in shown


@pytest.mark.slow
@pytest.mark.parametrize("ahead", [True, False])
@pytest.mark.parametrize("kind", ["cma_es", "sep_cma_es", "xnes"])
def test_no_restart_exceeds_the_budget_of_generations(kind: str, ahead: bool, tmp_path: Path) -> None:
    """Whether the engine evolves by itself or not; all candidates are equal, so that there are restarts."""
    method = {"kind": kind, "population": 20, "generations": 100, "restart": "ipop"}
    values = {**QUICK, "fitness": "0 * steps", "method": method}
    if not ahead:
        values["ranking"] = {"kind": "race", "episodes": 3, "first_test": 2}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    assert run.generations < 100
    assert 1000 <= run.evaluations <= 2000
    assert (run.state, run.ended) == ("done", "generations")
    assert resume(run).evaluations == run.evaluations
    less = Experiment.from_mapping({**values, "method": {**method, "evaluations": 900}})
    assert optimize(less, out=tmp_path / "less").ended == "evaluations"
    if kind == "xnes":  # whose restarts are not cut to what is left
        more = Experiment.from_mapping({**values, "method": {**method, "generations": 150}})
        assert resume(run, generations=150).digest == optimize(more, out=tmp_path / "more").digest


def test_the_nearest_limit_is_shown(tmp_path: Path) -> None:
    seen: list[Generation] = []
    optimize(experiment(generations=100, evaluations=60), seen.append, out=tmp_path / "run")
    assert {one.budget for one in seen} == {"evaluations"}
    assert [one.share for one in seen] == [one.evaluations / 60 for one in seen]
    assert seen[0].generations == 100
    assert seen[-1].seconds_left < 1


@pytest.mark.slow
def test_a_run_can_be_prolonged_and_not_cut(tmp_path: Path) -> None:
    run = optimize(experiment(generations=5, evaluations=50), out=tmp_path / "run")
    assert resume(run, settings=["method.evaluations=80", "servers=1"]).evaluations == 80
    for settings, words in (
        (["method.evaluations=10"], "evaluations: 10 is less than the experiment's 80"),
        (["method.population=30"], "only its budget can be changed"),
        (["seed=3"], "--set seed=3: seed: it is fixed when a run begins"),
    ):
        with pytest.raises(InputError, match=words):
            resume(run, settings=settings)
    with pytest.raises(InputError, match="generations: 2 is less than"):
        resume(run, generations=2)


def test_generations_that_are_expected() -> None:
    assert Budget(10, None, None).estimate_generations(0, 0) == 10
    assert Budget(None, 100, None).estimate_generations(2, 40) == 5
    assert Budget(4, 100, None).estimate_generations(2, 40) == 4
    assert Budget(None, None, 5.0).estimate_generations(7, 40) == 7


def test_the_time_left_of_races_is_that_of_the_generations_left(tmp_path: Path) -> None:
    """Not of the evaluations that the method would have without this limit."""
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "racing", "generations": 5, "evaluations": 1_000_000},
            "ranking": {"episodes": 1},
            "validate": False,
            "servers": "in-process",
        }
    )
    seen: list[Generation] = []
    optimize(experiment, seen.append, out=tmp_path / "run")
    assert [one.generation for one in seen] == [0, 1, 2, 3, 4]
    for one in seen:
        done = one.generation + 1
        assert one.seconds_left == pytest.approx(one.seconds / done * (5 - done))
