"""Runs of a sweep at the same time: the same results, and nothing lost when one of them ends badly."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Generation, InputError, Run, _engine
from swarmwright.analysis.sweep import Sweep, Variant, list_tasks
from swarmwright.analysis.sweep.execution import choose_servers
from swarmwright.analysis.sweep.remaining import Status
from swarmwright.common.errors import PlugInError
from swarmwright.methods import METHODS
from swarmwright.servers.supervision.local_servers import count_processors
from tests.python.cli.processes import children, gone

BASE = "simulation: minisim\nparameters: {maxSteps: 5}\nmethod: {population: 6, generations: 100}\n"
"""So many generations that a second job begins before the first has done all runs."""
SWEEP = "experiment: base.yaml\ngrid: {method.kind: [nnga, random_search]}\nseeds: 2\nout: results\n"
SLOW = "simulation: minisim\nmethod: {population: 6, generations: 20000}\nservers: local\n"
WALK = """\
simulation: tests/python/simulations/troubled.py:Walk
method: {population: 3, generations: 2}
servers: local
"""


def records(folder: Path) -> dict[str, str]:
    return {run.name: Run.open(run).digest for run in sorted(folder.iterdir()) if run.is_dir()}


def experiment(**changes: Any) -> Experiment:
    return Experiment.from_mapping({"simulation": "minisim", **changes})


@pytest.mark.slow
def test_the_results_and_what_is_said_are_those_of_one_after_the_other(program: Any, tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(BASE)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    said = []
    for out, arguments in (
        ("alone", ("--servers", "local", "--jobs", "1")),
        ("local", ("--servers", "local", "--jobs", "3")),
        ("servers", ("--servers", "3", "--jobs", "2")),
    ):
        result = program("sweep", "sweep.yaml", "--out", out, *arguments)
        assert result.returncode == 0, result.stderr
        assert result.stderr == ""
        ended = [line for line in result.stdout.splitlines() if line.startswith("[")]
        said.append([line.split(" evaluations")[0] for line in ended])
    assert said[0] == said[1] == said[2]
    assert said[0][1].startswith("[2/4] random_search, seed 1: best fitness ")
    assert records(tmp_path / "alone") == records(tmp_path / "local") == records(tmp_path / "servers")
    assert len(records(tmp_path / "alone")) == 4
    counts = set()
    # Of two runs at a time, the first has two servers, the second one, each on a broker of its own.
    runs = [Run.open(run) for run in (tmp_path / "servers").glob("*-?")]
    assert len({run.sessions[0].place for run in runs}) == 2, "a broker for each of the two"
    for run in runs:
        used = {attempt.server for attempt in run.attempts()}
        servers = int(run.sessions[0].place.split()[0])
        assert used <= set(range(1, servers + 1))
        counts.add(servers)
    assert counts == {1, 2}


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_variant_that_fails_does_not_stop_the_others(
    program: Any, tmp_path: Path, root: Path, jobs: str
) -> None:
    (tmp_path / "tests").symlink_to(root / "tests")
    (tmp_path / "base.yaml").write_text(WALK)
    grid = "grid: {parameters.trouble: [reset, '']}\nseeds: 1\nout: results\n"
    (tmp_path / "sweep.yaml").write_text(f"experiment: base.yaml\n{grid}")
    result = program("sweep", "sweep.yaml", "--jobs", jobs)
    assert result.returncode == 1
    lines = result.stdout.splitlines()
    assert lines[1].startswith("[1/2] trouble reset, seed 1: failed: every candidate of generation 0 failed")
    assert lines[2].startswith("[2/2] trouble , seed 1: best fitness")
    assert lines[-3].startswith("Failed: trouble reset, seed 1: every candidate")
    assert "LookupError: no start" in lines[-3]
    assert lines[-1] == "The figure is in results/comparison.png"


def begun(folder: Path) -> bool:
    try:
        return Run.open(folder).generations > 0
    except InputError:
        return False


def has_open(pid: int, folder: Path) -> bool:
    return any(link.readlink().is_relative_to(folder) for link in Path(f"/proc/{pid}/fd").iterdir())


@pytest.mark.slow
def test_when_a_process_is_killed_the_others_go_on_and_when_all_are_no_process_stays(
    start: Any, tmp_path: Path
) -> None:
    (tmp_path / "base.yaml").write_text(SLOW)
    (tmp_path / "sweep.yaml").write_text(
        "experiment: base.yaml\ngrid: {method.population: [6, 7, 8]}\nseeds: 1\nout: results\n"
    )
    process = start("sweep", "sweep.yaml", "--jobs", "2", "--json")
    first, second, third = (tmp_path / "results" / f"population_{size}-1" for size in (6, 7, 8))
    deadline = time.monotonic() + 40

    def until(*folders: Path) -> None:
        while not all(map(begun, folders)):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.05)

    until(first, second)
    workers = children(process.pid)
    assert len(workers) == 2
    at_first = next(pid for pid in workers if has_open(pid, first))
    os.kill(at_first, signal.SIGKILL)
    assert '"error": "the worker process of this run was killed by signal 9"' in process.stdout.readline()
    until(third)
    assert {Run.open(run).state for run in (first, second)} == {"killed", "running"}
    process.kill()
    process.wait(10)
    assert gone([*workers, *children(process.pid)], 20)
    deadline = time.monotonic() + 20
    while Run.open(third).state == "running":
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert Run.open(third).state == "interrupted", "it ended in order"


def test_how_many_at_a_time() -> None:
    local, auto = experiment(servers="local"), experiment(servers=3)
    assert choose_servers([local], 100, None, broker=None, servers=None) == ["local"] * count_processors()
    assert choose_servers([local], 1, None, broker=None, servers=None) == ["local"]
    assert choose_servers([auto], 100, None, broker=None, servers=None) == [1, 1, 1]
    assert choose_servers([auto], 2, None, broker=None, servers=None) == [2, 1]
    assert choose_servers([auto], 9, 2, broker=None, servers=8) == [4, 4]
    assert choose_servers([auto], 9, 3, broker="mqtt://nobody:1", servers=None) == [None] * 3
    with pytest.raises(
        InputError, match="4 parallel runs need at least 4 servers, but only 3 would be started"
    ):
        choose_servers([auto], 9, 4, broker=None, servers=None)
    assert choose_servers([experiment()], 99, 16, broker=None, servers="auto") == [1] * 16


@pytest.mark.slow
def test_servers_on_a_broker_are_shared_where_one_run_has_no_use_for_all(
    embedded_broker: str, start: Any
) -> None:
    server = start("serve", "minisim", "--broker", embedded_broker, "--count", "5")
    assert "is ready" in server.stdout.readline()
    for _ in range(4):
        server.stdout.readline()
    small, large = (experiment(method={"kind": "random_search", "population": size}) for size in (2, 3))
    assert choose_servers([small], 9, None, broker=embedded_broker, servers=None) == [None] * 2
    assert choose_servers([small, large], 9, None, broker=embedded_broker, servers=None) == [None]


def test_the_generations_of_a_run_are_as_large_as_the_method_says(
    embedded_broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready = [{"state": "idle", "simulations": ["minisim"]}] * 44
    monkeypatch.setattr(_engine, "servers", lambda *_, **__: ready)
    for kind, candidates in (("cma_es", 11), ("snes", 20), ("cea2d", 100)):
        run = experiment(method={"kind": kind}, controller={"kind": "layered", "hidden": [2]})
        assert len(run.new_method(run.representation()).ask()) == candidates
        jobs = choose_servers([run], 9, None, broker=embedded_broker, servers=None)
        assert jobs == [None] * max(1, 44 // candidates), kind


@pytest.mark.parametrize("raised", [PlugInError("broken"), ValueError("broken")])
def test_a_plug_in_that_fails_does_not_end_the_sweep(
    monkeypatch: pytest.MonkeyPatch, embedded_broker: str, raised: Exception
) -> None:
    def fail(*_: Any) -> None:
        raise raised

    monkeypatch.setattr(_engine, "servers", lambda *_, **__: [])
    monkeypatch.setattr("swarmwright.common.plug_in_code.find_failure", lambda error: PlugInError(str(error)))
    run = experiment()
    monkeypatch.setattr(Experiment, "representation", fail)
    assert choose_servers([run], 2, None, broker=embedded_broker, servers=None) == [None]
    monkeypatch.setattr(METHODS.get("nnga"), "first_generation", fail)
    assert choose_servers([run], 2, None, broker=embedded_broker, servers=None) == [None]


def test_the_time_left_is_estimated_from_within_runs(tmp_path: Path) -> None:
    now = 100.0
    variants = tuple(
        Variant(kind, kind, experiment(method={"kind": kind, "generations": 10}))
        for kind in ("nnga", "random_search")
    )
    todo = list_tasks(Sweep(variants, (1, 2), tmp_path))
    status = Status(len(todo), lambda: now)
    status.begin(todo)
    status.on_plan(4, 2)
    assert status.seconds_left() is None
    status.on_begin(todo[0])
    status.on_begin(todo[1])
    status.generation(todo[0], generation(4, seconds=20.0, left=30.0))
    now += 5.0
    # 25 of the first; the three others take 20 + 25 + 5 as well, as far as is known; two at a time.
    assert status.seconds_left() == pytest.approx((25 + 3 * 45) / 2)
    status.generation(todo[1], generation(0, seconds=5.0, left=95.0))
    assert status.seconds_left() == pytest.approx((25 + 95 + 45 + 100) / 2)
    assert status.active_runs[todo[0]].share == 0.5
    status.evaluating(todo[0], 3, 6, "")
    assert status.active_runs[todo[0]].share == pytest.approx(0.55)
    status.on_failure(todo[1], "broken")
    status.on_begin(todo[2])
    assert (status.failures, status.finished) == (1, 0)
    assert status.seconds_left() == pytest.approx((25 + 45 + 45) / 2)


def test_how_far_a_run_is_counts_what_limits_it(tmp_path: Path) -> None:
    limits: dict[str, dict[str, Any]] = {
        "0 of 10 generations": {"generations": 10},
        "0 of 200 evaluations": {"evaluations": 200},
        "0 generations, 0.0 s of 1 min 00 s": {"seconds": 60},
    }
    for words, limit in limits.items():
        variant = Variant("nnga", "nnga", experiment(method={"kind": "nnga", **limit}))
        status = Status(1)
        (task,) = list_tasks(Sweep((variant,), (1,), tmp_path))
        status.begin([task])
        status.on_begin(task)
        assert status.active_runs[task].words == f"nnga, seed 1: {words}"
    status.generation(task, replace(generation(4, seconds=20.0, left=30.0), budget="seconds"))
    assert status.active_runs[task].words == "nnga, seed 1: 5 generations, 30 s of 1 min 00 s"


def generation(number: int, *, seconds: float, left: float) -> Generation:
    return Generation(
        generation=number, generations=10, best=0.0, mean=0.0, best_so_far=0.0, failed=0,
        failed_so_far=0, evaluations=1,
        seconds=seconds, evaluations_per_second=1.0, seconds_left=left, waiting_for="",
        share=(number + 1) / 10,
    )  # fmt: skip
