"""A server that is asked to end, as schedulers do it, finishes what it computes."""

import signal
import sqlite3
import threading
import time
from pathlib import Path

import pytest

from swarmwright import Experiment, optimize
from tests.conftest import Start
from tests.paced_simulation import written


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_on_sigterm_the_request_under_way_is_finished(
    start: Start, embedded_broker: str, tmp_path: Path
) -> None:
    name = written(tmp_path / "simulation")
    file = tmp_path / "simulation" / "paced.py"
    marker = tmp_path / "begun"
    note = "__import__('pathlib').Path(__import__('os').environ['BEGUN']).touch(); time.sleep(0.1)"
    file.write_text(file.read_text().replace("time.sleep(0.002)", note))  # 2 s an episode
    place = ("serve", name, "--broker", embedded_broker, "--json")
    leaving = start(*place, "--id", "1", "--grace", "60", env={"BEGUN": str(marker)})
    staying = start(*place, "--id", "2", env={"BEGUN": str(tmp_path / "other")})
    for server in (leaving, staying):
        assert server.stdout is not None
        assert server.stdout.readline()

    def preempt() -> None:
        while not marker.exists():
            time.sleep(0.01)
        leaving.send_signal(signal.SIGTERM)

    with_best_of = threading.Thread(target=preempt)
    with_best_of.start()
    experiment = Experiment.from_mapping(
        {"simulation": name, "method": {"population": 6, "generations": 1}, "validate": False}
    )
    run = optimize(experiment, broker=embedded_broker, out=tmp_path / "run", progress=False)
    with_best_of.join()
    assert leaving.wait(30) == 0
    with sqlite3.connect(run.path / "run.sqlite") as store:
        attempts = store.execute("SELECT server, attempt, error FROM attempt").fetchall()
    store.close()
    assert (1, 1, None) in attempts  # finished, not given back
    assert sum(server == 2 for server, _, _ in attempts) == 5
