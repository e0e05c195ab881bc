"""Servers as jobs of Slurm: the same record, an empty queue, errors in its words."""

import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Run, RunError, optimize
from swarmwright.testing import check_launcher
from tests import conftest
from tests.paced_simulation import written
from tests.python.records import same_record
from tests.slurm.conftest import Cluster, until
from tests.system.processes import Program

COMMAND = f"{sys.executable} -m swarmwright"


def options(folder: Path, **others: Any) -> dict[str, Any]:
    return {"command": COMMAND, "folder": str(folder), "broker_host": "127.0.0.1", **others}


def experiment(folder: Path, simulation: str = "minisim", **servers: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "method": {"population": 20, "generations": 12},
            "validate": False,
            "servers": {"launcher": "slurm", "count": 2, **options(folder, **servers)},
        }
    )


@pytest.mark.timeout(180)
def test_the_conformance_check(slurm: Cluster, tmp_path: Path) -> None:
    check_launcher("slurm", options(tmp_path), alive=lambda: len(slurm.queue()))
    assert not list((tmp_path / "run").iterdir())


@pytest.mark.timeout(240)
def test_a_cancelled_job_and_a_drained_node_change_nothing(slurm: Cluster, tmp_path: Path) -> None:
    from swarmwright.servers.evaluation.launched.servers import find_own_address

    made = experiment(tmp_path / "shared", written(tmp_path / "simulation"), broker_host=find_own_address())
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    done: list[int] = []

    def disturb(generation: Any) -> None:
        done.append(generation.generation)
        if len(done) == 2:
            until(lambda: len(slurm.running()) == 2)
            gone = slurm.running()[0]
            slurm.run("scancel", gone)
            until(lambda: len(slurm.running()) == 2 and gone not in slurm.running())
        if len(done) == 8:
            slurm.set_node("State=DRAIN", "Reason=test")
            slurm.run("scancel", slurm.running()[0])
            until(lambda: any("PENDING" in line for line in slurm.queue()))
        if len(done) == 10:
            slurm.set_node("State=RESUME")
            until(lambda: len(slurm.running()) == 2)
        if len(done) == 4:
            slurm.stop_controller()
        if len(done) == 6:
            slurm.start_controller()

    same_record(optimize(made, disturb, out=tmp_path / "there", progress=False), here)
    assert len(done) == 12
    assert slurm.queue() == []
    assert not list((tmp_path / "shared" / "run").iterdir())


@pytest.mark.timeout(400)
def test_time_limits_end_in_the_middle_of_evaluations(slurm: Cluster, tmp_path: Path) -> None:
    """Slurm asks the servers to end 30 s to 90 s before the limit: each time in an episode of 8 s."""
    from swarmwright.servers.evaluation.launched.servers import find_own_address

    name = written(tmp_path / "simulation")
    file = tmp_path / "simulation" / "paced.py"
    pause = "time.sleep(float(__import__('os').environ.get('PAUSE_S', 0)))"
    file.write_text(file.read_text().replace("time.sleep(0.002)", pause))
    made = experiment(
        tmp_path / "shared", name, broker_host=find_own_address(), time=2, environment={"PAUSE_S": "0.4"}
    ).replace(method={"population": 16, "generations": 2})
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    there = optimize(made, out=tmp_path / "there", progress=False)
    same_record(there, here)
    errors = [attempt.error for attempt in there.attempts() if attempt.error]
    assert [error for error in errors if error.startswith("server ") and error.endswith(" left")], errors
    assert not [event.text for event in there.events() if "fail" in event.text]
    assert slurm.queue() == []


@pytest.mark.timeout(120)
def test_waiting_in_the_queue_is_reported_with_its_reason(
    slurm: Cluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    slurm.set_node("State=DRAIN", "Reason=test")

    def resumed() -> None:
        until(lambda: "servers are waiting: pending (" in caplog.text)
        slurm.set_node("State=RESUME")

    made = experiment(tmp_path / "shared")
    in_thread(resumed, lambda: optimize(made, out=tmp_path / "run", progress=False))
    assert "slurm: 2 of 2 servers are waiting: pending (" in caplog.text


def in_thread(beside: Callable[[], None], work: Callable[[], object]) -> None:
    import threading

    thread = threading.Thread(target=beside)
    thread.start()
    try:
        work()
    finally:
        thread.join()


@pytest.mark.parametrize(
    ("servers", "message"),
    [
        ({"partition": "nope"}, r"sbatch: error: .*[Ii]nvalid partition"),
        ({"time": "2-00:00:00"}, r"sbatch: error: .*[Tt]ime limit"),
        ({"cpus": 64}, r"sbatch: error: .*More processors requested"),
        ({"arguments": ["--nonsense"]}, r"sbatch: unrecognized option '--nonsense'"),
        ({"command": "/opt/no/swarmwright"}, r"no server starts:(.|\n)*/opt/no/swarmwright: not found"),
    ],
)
@pytest.mark.timeout(120)
def test_what_is_wrong_is_said_in_the_words_of_slurm(
    slurm: Cluster, tmp_path: Path, servers: dict[str, Any], message: str
) -> None:
    with pytest.raises(RunError, match=message):
        optimize(experiment(tmp_path / "shared", **servers), out=tmp_path / "run", progress=False)
    assert slurm.queue() == []


@pytest.mark.timeout(120)
def test_on_the_command_line(slurm: Cluster, tmp_path: Path, program: conftest.Run) -> None:
    experiment(tmp_path / "shared").save(tmp_path / "lab.yaml")
    result = program("optimize", "lab.yaml", "--servers", "slurm:1", "--out", "run", timeout=100)
    assert result.returncode == 0, result.stderr
    result = program("optimize", "lab.yaml", "--set", "servers.partition=nope", "--out", "other")
    assert result.returncode == 1
    assert "swarmwright: slurm: sbatch: error: " in result.stderr
    assert slurm.queue() == []


@pytest.mark.parametrize("first", ["in-process", "process:2"])
@pytest.mark.timeout(120)
def test_a_run_that_was_started_on_this_machine_goes_on_on_the_cluster(
    slurm: Cluster, tmp_path: Path, first: str
) -> None:
    made = experiment(tmp_path / "shared", written(tmp_path / "simulation"))
    # Options of the cluster are in the experiment, or they are named when they are needed.
    known = first == "process:2"
    (made if known else made.replace(servers="auto")).save(tmp_path / "lab.yaml")
    begun = Program("optimize", "lab.yaml", "--servers", first, "--out", "run", "--json", cwd=tmp_path)
    try:
        begun.until(lambda run: sum("best_so_far" in line for line in run.lines) >= 4, "4 generations", 60)
        begun.signal(signal.SIGINT)
        assert begun.wait() == 130, begun.stderr
    finally:
        begun.stop()
    assert slurm.queue() == []
    (tmp_path / "run").rename(tmp_path / "moved")
    stored = Run.open(tmp_path / "moved").generations
    assert 4 <= stored < 12
    # More than an array may have on this cluster.
    servers = {"launcher": "slurm", "count": 3, **options(tmp_path / "shared")}
    named = ["--servers", "slurm:3"] if known else ["--set", f"servers={json.dumps(servers)}"]
    resumed = Program("resume", "moved", *named, "--json", cwd=tmp_path)
    try:
        assert resumed.wait(90) == 0, resumed.stderr
    finally:
        resumed.stop()
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    there = Run.open(tmp_path / "moved")
    same_record(there, here)
    assert len({attempt.server for attempt in there.attempts() if attempt.generation >= stored}) > 1
    assert slurm.queue() == []
