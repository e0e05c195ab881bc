"""Going on with a run gives what an undisturbed one gives."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Generation, InputError, Run, RunError, optimize, resume
from swarmwright.cli._main import run as command
from swarmwright.runs.optimization.optimize import _new_loop
from swarmwright.runs.store import StoreReader, StoreWriter
from tests.python.records import same_record

VALUES: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
    "method": {"population": 20, "generations": 12},
    "ranking": {"episodes": 2},
    "servers": "local",
    "seed": 5,
}
EXPERIMENT = Experiment.from_mapping(VALUES)
NOISY = EXPERIMENT.replace(ranking={"seeds": "new", "reevaluate": True, "aggregate": "cvar", "level": 0.5})


def until(generation: int) -> Any:
    def go_on(now: Generation) -> bool:
        return now.generation + 1 < generation

    return go_on


@pytest.fixture(scope="module", params=["plain", "noisy"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An undisturbed run."""
    experiment = EXPERIMENT if request.param == "plain" else NOISY
    return optimize(experiment, out=tmp_path_factory.mktemp("whole") / "run")


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 6, 11])
def test_it_goes_on_as_if_nothing_had_happened(at: int, whole: Run, tmp_path: Path) -> None:
    part = optimize(whole.experiment, until(at), out=tmp_path / "run")
    assert (part.generations, part.state) == (at, "stopped")
    told: list[int] = []
    run = resume(part, lambda now: told.append(now.generation), servers=2)
    assert told == list(range(at, 12))
    same_record(run, whole)
    assert run.state == "done"
    assert [session.outcome for session in run.sessions] == ["stopped", "done"]
    assert run.best == whole.best


def test_a_finished_run_is_left_as_it_is(whole: Run) -> None:
    again = resume(whole)
    same_record(again, whole)
    assert again.sessions == whole.sessions
    assert list(again.attempts()) == list(whole.attempts())


def test_a_finished_run_can_be_prolonged(whole: Run, tmp_path: Path) -> None:
    short = optimize(whole.experiment.replace(method={"generations": 7}), out=tmp_path / "run")
    assert short.state == "done"
    with pytest.raises(InputError, match="6 is less than the experiment's 7"):
        resume(short, generations=6)
    longer = resume(short, generations=12)
    same_record(longer, whole)
    assert longer.experiment == whole.experiment
    assert Experiment.load(longer.path / "experiment.yaml") == whole.experiment


@pytest.mark.parametrize(
    ("limit", "options", "generations"),
    [
        ({"evaluations": 60}, ["--evaluations", "90"], 5),
        ({"seconds": 1e-6}, ["--seconds", "1000", "--generations", "2"], 2),
        ({"generations": 1}, ["--generations", "9", "--evaluations", "60"], 3),
    ],
)
def test_the_command_raises_any_limit(
    limit: dict[str, Any], options: list[str], generations: int, tmp_path: Path
) -> None:
    run = optimize(EXPERIMENT.replace(method=limit, validate=False), out=tmp_path / "run")
    before = run.generations
    assert command(["resume", str(run.path), *options]) == 0
    again = Run.open(run.path)
    assert before < again.generations == generations
    assert again.state == "done"


@pytest.mark.parametrize(
    ("method", "budget", "reason"),
    [
        (
            {"evaluations": 60},
            {"generations": 300},
            ".* 60 evaluations; .*: --evaluations N",
        ),
        (
            {"generations": 3},
            {"evaluations": 9000},
            "all 3 generations are done; raise that limit as well: --generations N",
        ),
        ({"evaluations": 60}, {"evaluations": 61}, "the next generation would exceed 61 evaluations"),
        ({"generations": 3, "target": -99.0}, {"generations": 9}, "the target is reached; .* start_from="),
    ],
)
def test_a_larger_budget_that_leaves_nothing_to_evaluate(
    method: dict[str, Any], budget: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    run = optimize(EXPERIMENT.replace(method=method), out=tmp_path / "run")
    assert run.state == "done"
    with pytest.raises(InputError, match=f"nothing is left to evaluate with this budget, since {reason}"):
        resume(run, **budget)
    again = Run.open(run.path)
    assert (again.state, again.experiment, len(again.sessions)) == ("done", run.experiment, 1)


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
def test_a_store_with_more_generations_than_its_experiment_has(operation: str, tmp_path: Path) -> None:
    run = optimize(
        EXPERIMENT.replace(method={"generations": 3, "operation": operation}), out=tmp_path / "run"
    )
    fewer = run.experiment.replace(method={"generations": 2})
    with StoreWriter.resume(run.path.absolute()) as store:
        loop = _new_loop(fewer, fewer.representation(), store)
        with pytest.raises(InputError, match="the store has more generations than its experiment"):
            loop.replay(StoreReader(run.path))


@pytest.mark.parametrize(
    ("restart", "generations", "last"),
    # the rest of the budget; as many as in the first generation, as in the one before; cuts nothing
    [
        ("ipop", 40, 90),
        ("ipop", 8, 10),
        ("ipop", 11, 40),
        ("bipop", 29, 10),
        ("ipop", 31, None),
        ("bipop", 45, None),
    ],
)  # fmt: skip
def test_a_restart_that_the_budget_cut_ends_what_can_be_prolonged(
    restart: str, generations: int, last: int | None, tmp_path: Path
) -> None:
    # Where all are equal, a start ends soon, and the next one has twice as many candidates.
    flat = EXPERIMENT.replace(
        fitness="0 * distance",
        method={"kind": "cma_es", "population": 10, "generations": generations, "restart": restart},
    )
    run = optimize(flat, out=tmp_path / "flat")
    if last is None:
        longer = optimize(flat.replace(method={"generations": 80}), out=tmp_path / "longer")
        assert resume(run, generations=80).digest == longer.digest
        return
    with pytest.raises(InputError, match=f"limited its last restart to {last} candidates.*start_from="):
        resume(run, generations=80)
    assert Run.open(run.path).digest == run.digest


def test_a_run_that_was_returned_stays_as_long_as_it_was(whole: Run, tmp_path: Path) -> None:
    part = optimize(whole.experiment, until(4), out=tmp_path / "run")
    assert resume(part).generations == 12
    assert part.generations == len(part.history) == 4
    assert part.history == whole.history[:4]


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 6])
@pytest.mark.parametrize("kind", ["nnga", "cea2d", "random_search"])
def test_steady_state_goes_on_as_if_nothing_had_happened(kind: str, at: int, tmp_path: Path) -> None:
    size = {"width": 4, "height": 5} if kind == "cea2d" else {"population": 20}
    method = {"kind": kind, "operation": "steady_state", "in_flight": 7, "generations": 9, **size}
    experiment = Experiment.from_mapping({**VALUES, "method": method})
    whole = optimize(experiment, out=tmp_path / "whole")
    part = optimize(experiment, until(at), servers=2, out=tmp_path / "run")
    assert (part.generations, part.state) == (at, "stopped")
    run = resume(part, servers=1)
    same_record(run, whole)
    assert run.best == whole.best
    assert list(run.record.generation) == sorted(run.record.generation)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("operation", "kills", "generations"), [("generational", 30, 4000), ("steady_state", 15, 4000)]
)
def test_killed_many_times(operation: str, kills: int, generations: int, tmp_path: Path) -> None:
    """kill -9 at random moments, of whatever it is doing: starting, evaluating, committing, replaying."""
    experiment = EXPERIMENT.replace(
        method={"population": 20, "generations": generations, "operation": operation},
        ranking={"episodes": 30},
    )
    whole = optimize(experiment, out=tmp_path / "whole")
    experiment.save(tmp_path / "x.yaml")
    folder = tmp_path / "run"
    moments = random.Random(1)
    reached = [0]
    for number in range(kills):
        started = (folder / "run.sqlite").exists()
        command = ["resume", "run"] if started else ["optimize", "x.yaml", "--out", "run"]
        with subprocess.Popen(
            [sys.executable, "-m", "swarmwright", *command, "--json"],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            if number % 3 == 0:  # while it starts
                time.sleep(moments.uniform(0.05, 0.3))
            else:  # after one generation at least
                process.stdout.readline()
                time.sleep(moments.uniform(0, 0.02))
            process.kill()
            _, errors = process.communicate(timeout=30)
        if process.returncode == 0 and number >= kills // 2:  # it has come to its end before
            break
        assert process.returncode == -signal.SIGKILL, errors
        if number % 10 == 9 or number == kills - 1:
            run = Run.open(folder)
            assert run.state == "killed"
            assert run.record.genomes.tobytes() == whole.record.genomes[: run.evaluations].tobytes()
            reached.append(run.generations)
    assert reached == sorted(set(reached)), "it must get on, whatever happens to it"
    same_record(resume(folder), whole)


@pytest.mark.slow
def test_a_run_goes_on_elsewhere(whole: Run, tmp_path: Path) -> None:
    """The folder can be moved, and other servers can finish the work."""
    part = optimize(whole.experiment, until(4), servers=2, out=tmp_path / "run")
    part.path.rename(tmp_path / "moved")
    run = resume(tmp_path / "moved", servers="local")
    same_record(run, whole)
    assert {attempt.session for attempt in run.attempts()} == {1}


def test_a_run_that_ended_after_its_last_generation_becomes_done(whole: Run, tmp_path: Path) -> None:
    def interrupt(now: Generation) -> None:
        if now.generation == 11:
            raise KeyboardInterrupt

    run = optimize(whole.experiment, interrupt, out=tmp_path / "run")
    assert (run.generations, run.state) == (12, "interrupted")
    (run.path / "best.json").unlink()
    again = resume(run)
    assert again.state == "done"
    same_record(again, whole)
    assert len(resume(again).sessions) == 2


def test_a_larger_budget_counts_only_when_there_is_somebody_to_work(
    whole: Run, tmp_path: Path, unused_port: int
) -> None:
    short = optimize(whole.experiment.replace(method={"generations": 2}), out=tmp_path / "run")
    with pytest.raises(RunError):
        resume(short, generations=12, broker=f"mqtt://127.0.0.1:{unused_port}")
    assert Run.open(short.path).experiment.generations == 2
    assert Experiment.load(short.path / "experiment.yaml").generations == 2


@pytest.mark.parametrize("ahead", [True, False])
def test_false_in_the_last_generation_changes_nothing(ahead: bool, tmp_path: Path) -> None:
    method = {"kind": "cma_es"} if ahead else {}
    experiment = EXPERIMENT.replace(method={**method, "population": 8, "generations": 3})
    run = optimize(experiment, until(3), out=tmp_path / "run")
    assert (run.generations, run.state, run.ended) == (3, "done", "generations")
    limited = experiment.replace(method={"generations": 12, "evaluations": run.evaluations})
    run = optimize(limited, until(3), out=tmp_path / "limited")
    assert (run.generations, run.state, run.ended) == (3, "done", "evaluations")
    assert optimize(experiment, until(2), out=tmp_path / "stopped").state == "stopped"


def test_starting_is_not_counted_when_a_run_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swarmwright.runs.optimization import optimize as module
    from swarmwright.runs.optimization.two_simulations import open_simulations

    limit = 20.0
    experiment = EXPERIMENT.replace(method={"population": 4, "seconds": limit})
    part = optimize(experiment, until(2), out=tmp_path / "run")
    offset, clock = [0.0], time.monotonic

    def slow(*arguments: Any, **options: Any) -> Any:
        offset[0] += 2 * limit  # as servers that take long to start
        return open_simulations(*arguments, **options)

    monkeypatch.setattr(module, "open_simulations", slow)
    monkeypatch.setattr(time, "monotonic", lambda: clock() + offset[0])
    assert resume(part, until(5)).generations == 5
