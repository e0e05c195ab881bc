"""Figures for Prometheus: scraped from real runs, read by prometheus-client's own parser."""

import json
import re
import socket
import threading
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from swarmwright import InputError
from swarmwright.runs.monitoring import metrics_server
from swarmwright.runs.monitoring.prometheus import ServerMetrics, ToolMetrics, serve_metrics
from tests.python.cli.test_services import events

LONG = """\
simulation: minisim
mode: {}
method: {{kind: random_search, population: 12, generations: 100000}}
seed: 3
"""


def scraped(url: str) -> dict[str, dict[tuple[str, ...], float]]:
    """Values by the sample's name and labels."""
    with urllib.request.urlopen(url, timeout=10) as answer:
        assert answer.headers["Content-Type"].startswith("text/plain")
        text = answer.read().decode()
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation
        for sample in family.samples:
            assert sample.name.startswith("swarmwright_")
            assert sample.name.endswith("_total") == (family.type == "counter")
            found.setdefault(sample.name, {})[tuple(sample.labels.values())] = sample.value
    return found


def url_of(process: Any) -> str:
    while line := process.stdout.readline():
        if match := re.search(r"http://\S+/metrics", line):
            return match[0]
    raise AssertionError(process.stderr.read())


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_a_run_is_scraped(start: Any, tmp_path: Path, mode: str) -> None:
    (tmp_path / "e.yaml").write_text(LONG.format(mode))
    process = start("optimize", "e.yaml", "--servers", "2", "--out", "r", "--metrics", "0")
    url = url_of(process)
    assert url.startswith("http://127.0.0.1:")
    while process.stdout.readline().count("generations") == 0:
        pass
    nothing = ()
    first, second = scraped(url), scraped(url)
    while second["swarmwright_generation"][nothing] <= first["swarmwright_generation"][nothing]:
        second = scraped(url)
    assert second["swarmwright_generations"][nothing] == 100000
    assert second["swarmwright_candidates_total"][nothing] % 12 == 0
    generation = second["swarmwright_generation"][nothing]
    assert second["swarmwright_candidates_total"][nothing] == 12 * (generation + 1)
    # What is under way counts, too.
    assert second["swarmwright_evaluations_total"][nothing] >= 12 * (generation + 1)
    assert second["swarmwright_attempts_total"][mode, "done"] > 0
    assert (mode, "failed") not in second["swarmwright_attempts_total"]
    servers = second["swarmwright_servers"]
    assert servers["ready",] + servers["busy",] == 2
    assert servers["lost",] == servers["benched",] == 0
    assert second["swarmwright_broker_connected"][nothing] == 1
    assert second["swarmwright_broker_received_bytes_total"][nothing] > 1000
    assert second["swarmwright_best_fitness"][nothing] <= 0


@pytest.mark.slow
def test_a_run_in_this_process_has_figures_too(start: Any, tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(LONG.format("auto"))
    process = start("optimize", "e.yaml", "--servers", "local", "--out", "r", "--metrics", "127.0.0.1:0")
    url = url_of(process)
    while process.stdout.readline().count("generations") == 0:
        pass
    assert scraped(url)["swarmwright_candidates_total"][()] >= 12


@pytest.mark.slow
def test_servers_are_scraped(start: Any, embedded_broker: str) -> None:
    options = ("--broker", embedded_broker, "--count", "2", "--metrics", "0")
    process = start("serve", "minisim", *options)
    url = url_of(process)
    while scraped(url)["swarmwright_servers"]["ready",] < 2:
        pass
    assert scraped(url)["swarmwright_server_events_total"]["ready",] == 2


def status(done: int, total: int) -> dict[str, Any]:
    return {"event": "status", "status": {"done": done, "total": total}, "traffic": {}}


def test_evaluations_are_counted_once_over_pieces_of_work() -> None:
    figures = ToolMetrics()
    for done, total in [(0, 10), (4, 10), (10, 10), (10, 10), (3, 10), (10, 10), (2, 2), (0, 10)]:
        figures.report(status(done, total))
    families = {family.name: family.samples[0].value for family in figures.collect() if family.samples}
    assert families["swarmwright_evaluations"] == 10 + 10 + 10 + 2
    assert families["swarmwright_evaluations_pending"] == 10


def test_incidents_are_counted() -> None:
    figures = ToolMetrics()
    for event in (
        {"event": "server", "server": 1, "state": "busy"},
        {"event": "server", "server": 2, "state": "ready"},
        {"event": "server", "server": 2, "state": "left"},
        {"event": "attempt", "mode": "batched", "outcome": "server_failed"},
        {"event": "attempt", "mode": "batched", "outcome": "overtaken"},
        {"event": "benched", "server": 1},
        {"event": "broker_lost", "reason": "gone"},
        {**status(1, 2), "counts": {"late": 3, "unknown": 1}},
    ):
        figures.report(event)
    found = {(s.name, *s.labels.values()): s.value for family in figures.collect() for s in family.samples}
    assert found["swarmwright_servers", "busy"] == 1
    assert found["swarmwright_servers", "ready"] == 0
    assert found["swarmwright_attempts_total", "batched", "server_failed"] == 1
    assert found["swarmwright_attempts_total", "batched", "overtaken"] == 1
    assert found["swarmwright_pool_benched_total",] == found["swarmwright_pool_broker_losses_total",] == 1
    assert found["swarmwright_pool_late_total",] == 3
    assert found["swarmwright_broker_connected",] == 0
    figures.report({"event": "broker_back"})
    assert {f.name: f.samples for f in figures.collect()}["swarmwright_broker_connected"][0].value == 1


def test_silent_servers_are_told_apart() -> None:
    figures = ToolMetrics()
    waiting = [{"server": server, "silent": silent} for server, silent in [(3, 9.5), (1, 2.0), (3, 4.0)]]
    waiting += [{"server": 100 + server, "silent": 0.0} for server in range(20)]
    figures.report(
        {"event": "status", "status": {"done": 1, "total": 2, "waiting_for": waiting}, "traffic": {}}
    )
    found = {(s.name, *s.labels.values()): s.value for family in figures.collect() for s in family.samples}
    silent = {key[1]: value for key, value in found.items() if key[0] == "swarmwright_server_silence_seconds"}
    assert silent == {"3": 9.5, "1": 2.0, **{str(100 + server): 0.0 for server in range(8)}}
    assert found["swarmwright_silence_seconds",] == 9.5


def test_an_address_that_is_taken_is_named() -> None:
    with serve_metrics(ServerMetrics(), "127.0.0.1", 0) as url:
        port = int(url.split(":")[2].split("/")[0])
        with (
            pytest.raises(InputError, match=f"cannot listen on 127.0.0.1:{port}"),
            serve_metrics(ServerMetrics(), "127.0.0.1", port),
        ):
            pass


@pytest.mark.slow
@pytest.mark.parametrize("value", ["", "x", "127.0.0.1:", "127.0.0.1:99999", "1.5"])
def test_what_is_no_address_is_refused(program: Any, tmp_path: Path, value: str) -> None:
    (tmp_path / "e.yaml").write_text(LONG.format("auto"))
    refused = program("optimize", "e.yaml", "--metrics", value)
    assert refused.returncode == 2
    assert "--metrics" in refused.stderr


@pytest.mark.slow
def test_json_is_not_disturbed(start: Any, embedded_broker: str) -> None:
    process = start("serve", "minisim", "--broker", embedded_broker, "--metrics", "0", "--json")
    (ready,) = events(process, "ready")
    assert json.dumps(ready)


def test_idle_connections_keep_no_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(metrics_server, "MAX_CONNECTION_S", 1.0)
    before = set(threading.enumerate())

    def added() -> int:
        # Threads of earlier tests may be ending.
        return len(set(threading.enumerate()) - before)

    with ExitStack() as stack:
        url = stack.enter_context(serve_metrics(ServerMetrics(), "127.0.0.1", 0))
        port = int(url.split(":")[2].split("/")[0])
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(100)]
        for connection in idle[::2]:
            connection.sendall(b"GET /metrics HTTP/1.1\r\nX-Slow: ")
        for _ in range(20):
            assert "swarmwright_start_time_seconds" in scraped(url)
            # The server's own thread, and those that are just ending.
            assert added() <= metrics_server.MAX_CONNECTIONS + 4
        deadline = time.monotonic() + 20
        while added() > 1 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert added() == 1
