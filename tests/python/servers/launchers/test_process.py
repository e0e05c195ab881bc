"""Servers as processes of this machine."""

import os
import signal
import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, RunError, optimize
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.evaluation.launched.servers import find_own_address
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.evaluation.through_broker import BrokerBackend
from swarmwright.servers.launchers import LauncherError, Specification
from swarmwright.servers.launchers._slot import Slot
from swarmwright.servers.launchers.process import Process, ProcessOptions
from swarmwright.servers.supervision import Supervisor
from swarmwright.servers.supervision.process import Process as ServerProcess
from swarmwright.testing import check_launcher
from tests.paced_simulation import written
from tests.python.records import same_record


def experiment(**servers: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "method": {"population": 20, "generations": 4},
            "validate": False,
            "servers": {"launcher": "process", "count": 2, **servers},
        }
    )


@pytest.mark.slow
def test_the_conformance_check() -> None:
    check_launcher("process")


@pytest.mark.slow
def test_the_record_is_that_of_other_servers_with_tls_and_accounts_too(tmp_path: Path) -> None:
    here = optimize(experiment(), out=tmp_path / "here", servers="in-process", progress=False)
    started = optimize(experiment(), out=tmp_path / "started", progress=False)
    same_record(started, here)
    # As servers on other machines reach this one: the broker has TLS and an account for each launcher.
    before = dict(os.environ)
    reached = optimize(experiment(broker_host=find_own_address()), out=tmp_path / "reached", progress=False)
    same_record(reached, here)
    assert dict(os.environ) == before


@pytest.mark.slow
def test_a_killed_server_is_started_again() -> None:
    with open_backend(experiment()) as backend:
        assert isinstance(backend, BrokerBackend)
        supervisor = backend._servers._entries[0].launcher._supervisor  # type: ignore[union-attr]
        first = supervisor.pids
        assert len(first) == 2
        os.kill(first[0], signal.SIGKILL)
        while supervisor.restarts == 0:
            backend.check()
        while len(supervisor.pids) < 2:
            backend.check()
        assert first[1] in supervisor.pids
    assert not any(Path(f"/proc/{pid}").exists() for pid in first)


@pytest.mark.journey
@pytest.mark.timeout(120)
@pytest.mark.parametrize(("mode", "recycle"), [("auto", 20), ("stepwise", 20), ("batched", 1)])
def test_processes_are_replaced_after_some_evaluations(
    mode: str, recycle: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[int, int]] = []
    ask = ServerProcess.recycle

    def noted(process: ServerProcess) -> None:
        told.append((process.identifier, process.progress.read().ended))
        ask(process)

    monkeypatch.setattr(ServerProcess, "recycle", noted)
    slow = Experiment.from_mapping(
        {
            "simulation": written(tmp_path / "simulation"),
            "mode": mode,
            "method": {"population": 20, "generations": 4},
            "validate": False,
            "servers": {"launcher": "process", "count": 2, "recycle": recycle},
        }
    )
    recycled = optimize(slow, out=tmp_path / "recycled", progress=False)
    same_record(optimize(slow, out=tmp_path / "here", servers="in-process", progress=False), recycled)
    log = (tmp_path / "recycled" / "servers.log").read_text()
    assert "[has reached its quota of evaluations (recycle)]" in log
    if mode != "batched":  # where a server may get no second batch
        # Those that begin together are not replaced together.
        (early, first), (late, second) = told[:2]
        assert early != late
        assert 10 <= first < 20 <= second
    with closing(sqlite3.connect(recycled.path / "run.sqlite")) as store:
        errors = [error for (error,) in store.execute("SELECT error FROM attempt WHERE error NOT NULL")]
    # What had begun was given back, which counts against no candidate, unless the broker was slow.
    assert "interrupted" not in errors
    assert sum(error.endswith((" left", " was faster")) for error in errors) >= len(errors) / 2, errors


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize("mode", ["auto", "stepwise"])
def test_a_preempted_server_finishes_what_it_computes(mode: str, tmp_path: Path) -> None:
    name = written(tmp_path / "simulation")
    file = tmp_path / "simulation" / "paced.py"
    begun = tmp_path / "begun"
    note = "import os; open(os.environ['BEGUN'], 'w').write(str(os.getpid())); time.sleep(0.05)"
    file.write_text(file.read_text().replace("time.sleep(0.002)", note))  # 1 s an episode
    sent: list[float] = []

    def preempt() -> None:
        while not (begun.exists() and begun.read_text()):
            time.sleep(0.01)
        sent.append(time.time())
        os.kill(int(begun.read_text()), signal.SIGTERM)

    beside = threading.Thread(target=preempt)
    beside.start()
    made = experiment(count=1, environment={"BEGUN": str(begun)}).replace(
        simulation=name, mode=mode, method={"population": 3, "generations": 1}
    )
    run = optimize(made, out=tmp_path / "run", progress=False)
    beside.join()
    with closing(sqlite3.connect(run.path / "run.sqlite")) as store:
        attempts = store.execute("SELECT started, seconds, error FROM attempt").fetchall()
    finished = [
        started < sent[0] < started + seconds for started, seconds, error in attempts if error is None
    ]
    assert sum(finished) == 1
    assert "was killed by SIGTERM" in (run.path / "servers.log").read_text()


def test_states_of_servers_that_are_not_watched_any_more_are_not_known(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("a mistake")

    made = experiment()
    assert isinstance(made.servers, tuple)
    (options,) = made.servers
    assert isinstance(options, ProcessOptions)
    launcher = Process(options, Specification(simulation="minisim", broker="mqtt://localhost:1"))
    launcher.open()
    try:
        monkeypatch.setattr(Supervisor, "_take_overdue", fail)
        assert launcher._supervisor is not None
        launcher._supervisor._thread.join(10)
        for method in (launcher.health, lambda: launcher.start([1])):
            with pytest.raises(
                LauncherError, match=r"supervision of servers failed: ValueError\('a mistake'\)"
            ):
                method()
    finally:
        launcher.close()
    assert "in fail" in caplog.text  # where it was raised


@pytest.mark.slow
def test_servers_that_do_not_start_are_given_up_with_what_they_printed(tmp_path: Path) -> None:
    file = tmp_path / "gather.py"
    file.write_text(
        "import swarmwright\n"
        "from swarmwright.simulations import loading\n"
        "if loading.serving: raise SystemExit('no licence for this machine')\n"
        "class Gather(swarmwright.Simulation):\n"
        "    title, dimensions, sensors, actuators, parameters = 'gather', 2, 1, 1, {}\n"
        "    def reset(self, parameters, seed): return [[0.0]]\n"
        "    def step(self, actuators): return [[0.0]]\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 0.0\n"
    )
    made = experiment().replace(simulation=f"{file}:Gather")
    with pytest.raises(RunError, match=r"(?s)process: no server starts:.*no licence for this machine"):
        optimize(made, out=tmp_path / "run", progress=False)


class StartedError(Exception):
    """Instead of starting a process."""


@pytest.mark.parametrize(
    ("credentials", "wanted"),
    [
        ({"username": "server", "password": "word"}, {"SWARMWRIGHT_USERNAME", "SWARMWRIGHT_PASSWORD_FILE"}),
        ({"certificate": "A", "key": "B"}, {"SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE"}),
    ],
)
def test_servers_do_not_get_credentials_of_the_tool(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, credentials: dict[str, Any], wanted: set[str]
) -> None:
    """Also on workers of a cluster, whose environment may be that of a tool."""
    for name in CREDENTIALS:
        monkeypatch.setenv(name, f"/tool/{name}")
    started: list[dict[str, str]] = []

    def start(*_: Any, env: dict[str, str], **__: Any) -> None:
        started.append({name: env[name] for name in CREDENTIALS if env.get(name)})
        raise StartedError

    specification = Specification("minisim", "mqtts://localhost:1", **credentials)
    with closing(Process(ProcessOptions(), specification)) as launcher:
        launcher.open()
        monkeypatch.setattr("subprocess.Popen", start)
        with pytest.raises(StartedError):
            launcher.start([1])
    with pytest.raises(StartedError):
        Slot(specification, 1, None, str(tmp_path)).run()
    assert [set(one) for one in started] == [wanted, wanted]
    assert not any(value.startswith("/tool/") for one in started for value in one.values())
