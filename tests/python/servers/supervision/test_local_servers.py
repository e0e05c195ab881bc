"""Servers that a run starts for itself: they start, they end, and their last words are heard."""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, RunError, _engine, evaluate
from swarmwright.servers.supervision import Supervisor
from swarmwright.servers.supervision.local_servers import LocalServers, automatic_count
from swarmwright.servers.supervision.process import Limits


def settings(broker: str, identifier: int = 1) -> dict[str, Any]:
    return {"simulation": "minisim", "broker": broker, "id": identifier, "prefix": "", "step_timeout": 5.0}


def listed(broker: str) -> dict[int, str]:
    return {one["server"]: one["state"] for one in _engine.servers(broker, wait=0.3)}


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


@pytest.mark.slow
def test_servers_are_there_for_the_time_of_the_block(any_broker: str) -> None:
    with LocalServers([settings(any_broker, index) for index in (5, 6, 7)]) as servers:
        assert listed(any_broker) == {5: "ready", 6: "ready", 7: "ready"}
        assert all(map(alive, servers.pids))
        pids = servers.pids
        servers.check()
        began = time.monotonic()
    assert time.monotonic() - began < 4
    assert not any(map(alive, pids))
    # They said good-bye: nothing is left on the broker.
    assert "ready" not in listed(any_broker).values()


@pytest.mark.slow
def test_no_broker(unused_port: int) -> None:
    with (
        pytest.raises(
            RunError, match=rf"simulation server 1 ended with status 1:\n.*127\.0\.0\.1:{unused_port}"
        ),
        LocalServers([settings(f"mqtt://127.0.0.1:{unused_port}")]),
    ):
        pytest.fail("started without a broker")


@pytest.mark.slow
def test_a_server_that_takes_longer_to_start_than_it_may(embedded_broker: str) -> None:
    with (
        pytest.raises(RunError, match=r"did not start within 0.001 s; increase timeouts.discovery"),
        LocalServers([settings(embedded_broker, 9)], limits=Limits(start=0.001)) as servers,
    ):
        pytest.fail(f"started: {servers.pids}")


@pytest.mark.slow
def test_two_servers_with_one_id(embedded_broker: str) -> None:
    with (
        LocalServers([settings(embedded_broker, 9)]) as first,
        pytest.raises(RunError, match=r"simulation server 9 ended with status 1:\n.*9"),
        LocalServers([settings(embedded_broker, 9)]),
    ):
        pytest.fail("started with an id that is taken")
    assert first.pids == []


@pytest.mark.slow
def test_an_error_in_the_block_leaves_nobody_behind(embedded_broker: str) -> None:
    pids: list[int] = []

    def fail() -> None:
        with LocalServers([settings(embedded_broker)]) as servers:
            pids.extend(servers.pids)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert pids
    assert not any(map(alive, pids))


@pytest.mark.slow
def test_an_error_while_servers_are_watched_is_raised(
    embedded_broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ValueError("a mistake")

    with LocalServers([settings(embedded_broker)]) as servers:
        servers.check()
        monkeypatch.setattr(Supervisor, "_check_server", fail)
        servers._supervisor._thread.join(10)
        with pytest.raises(RunError, match=r"the supervision of servers failed: ValueError\('a mistake'\)"):
            servers.check()


@pytest.mark.slow
def test_servers_draw_on_our_output_when_asked(tmp_path: Path) -> None:
    script = tmp_path / "visual.py"
    script.write_text(
        "from swarmwright import Experiment, simulate\n"
        "parameters = {'maxSteps': 3, 'stepSize': 1, 'helloMessage': 'Good morning'}\n"
        "experiment = Experiment.from_mapping({'simulation': 'minisim', 'parameters': parameters})\n"
        "simulate(experiment, visual=True)\n"
    )
    shown = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert shown.stdout.count("Good morning") >= 3
    assert shown.stderr == ""
    silent = subprocess.run(
        [sys.executable, "-c", script.read_text().replace("visual=True", "visual=False")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert silent.stdout == ""


def test_the_automatic_number_of_servers() -> None:
    assert 2 <= automatic_count() <= 8


MANY_METRICS = """
import numpy as np
from swarmwright import Simulation

class Measured(Simulation):
    sensors, actuators = 1, 1
    metrics = [f"metric_{index}" for index in range(9000)]

    def reset(self, parameters, seed):
        self.steps = 0
        return np.zeros((1, 1))

    def step(self, actions):
        self.steps += 1
        return np.zeros((1, 1))

    def done(self):
        return self.steps == 2

    def fitness(self):
        return 1.0

    def measure(self):
        return dict.fromkeys(self.metrics, 2.0)
"""


@pytest.mark.slow
def test_more_metrics_than_a_last_will_holds(tmp_path: Path) -> None:
    """A will of MQTT has 64 KiB; the names of these metrics have more."""
    (tmp_path / "measured.py").write_text(MANY_METRICS)
    experiment = Experiment.from_mapping(
        {"simulation": f"{tmp_path}/measured.py:Measured", "fitness": "metric_0 + metric_8999"}
    )
    genomes = np.zeros((2, experiment.genome_size), np.float32)
    assert evaluate(experiment, genomes, servers=1).tolist() == [4.0, 4.0]
