"""`--log FILE`: what is written of real runs, servers and brokers."""

import json
import signal
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError
from swarmwright.cli._observing import Log
from tests.python.cli.test_services import events

QUICK = "simulation: minisim\nmethod: {kind: random_search, population: 12, generations: 3}\nseed: 3\n"


def lines(file: Path) -> list[dict[str, Any]]:
    """Every line is an object with time, level and event."""
    found = [json.loads(line) for line in file.read_text().splitlines()]
    for line in found:
        moment = datetime.fromisoformat(line["time"])
        assert moment.tzinfo is not None
        assert line["level"] in {"debug", "info", "warning", "error"}
        assert line["event"]
    return found


def names(file: Path) -> list[str]:
    return [line["event"] for line in lines(file)]


@pytest.mark.journey
def test_a_run_is_logged_from_its_beginning_to_its_end(program: Any, tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    done = program(
        "optimize", "e.yaml", "--servers", "2", "--out", "r", "--log", "log", "--log-level", "debug"
    )
    assert done.returncode == 0, done.stderr
    found = lines(tmp_path / "log")
    said = [line["event"] for line in found]
    assert said[0] == "run_started"
    assert found[0]["seed"] == 3
    assert said[-1] == "run_ended"
    assert (found[-1]["state"], found[-1]["evaluations"]) == ("done", 36)
    assert [line["generation"] for line in found if line["event"] == "generation"] == [0, 1, 2]
    assert {line["server"] for line in found if line["event"] == "server_ready"} == {1, 2}
    attempts = [line for line in found if line["event"] == "attempt"]
    assert sum(line["candidates"] * line["episodes"] for line in attempts) == 36
    begin, end = (datetime.fromisoformat(found[place]["time"]).timestamp() for place in (0, -1))
    assert all(begin - 1 < line["started"] < end for line in attempts)
    assert "status" in said
    # Another run is appended; without --log-level there are no details.
    done = program("resume", "r", "--generations", "4", "--log", "log")
    assert done.returncode == 0, done.stderr
    more = names(tmp_path / "log")[len(said) :]
    assert (more[0], more[-1]) == ("run_started", "run_ended")
    assert not {"attempt", "status"} & set(more)


def test_attempts_that_another_server_overtook_are_no_failures(tmp_path: Path) -> None:
    with Log(tmp_path / "log", "debug") as log:
        for outcome in ("overtaken", "server_failed", "done"):
            log.report({"event": "attempt", "server": 1, "outcome": outcome})
    found = [(line["level"], line["event"]) for line in lines(tmp_path / "log")]
    assert found == [("debug", "attempt_overtaken"), ("warning", "attempt_failed"), ("debug", "attempt")]


@pytest.mark.slow
def test_the_log_goes_to_standard_error(program: Any, tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    done = program("optimize", "e.yaml", "--servers", "local", "--out", "r", "--log", "-")
    found = [json.loads(line) for line in done.stderr.splitlines()]
    assert [found[0]["event"], found[-1]["event"]] == ["run_started", "run_ended"]


@pytest.mark.slow
def test_what_ends_a_command_is_logged(program: Any, tmp_path: Path, unused_port: int) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    broker = f"mqtt://127.0.0.1:{unused_port}"
    assert program("optimize", "e.yaml", "--broker", broker, "--log", "log").returncode == 1
    last = lines(tmp_path / "log")[-1]
    assert (last["level"], last["event"]) == ("error", "failed")
    assert "no broker answers" in last["message"]


@pytest.mark.slow
def test_a_sweep_logs_each_run(program: Any, tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    (tmp_path / "s.yaml").write_text(
        "experiment: e.yaml\ngrid: {method.population: [12, 14]}\nseeds: 1\nout: all\n"
    )
    done = program("sweep", "s.yaml", "--servers", "local", "--log", "log")
    assert done.returncode == 0, done.stderr
    assert names(tmp_path / "log").count("run_ended") == 2


@pytest.mark.slow
def test_servers_and_broker_are_logged(start: Any, tmp_path: Path) -> None:
    broker = start("broker", "--port", "0", "--json", "--log", "broker.log")
    (listening,) = events(broker, "listening")
    serving = start(
        "serve", "minisim", "--broker", listening["url"], "--id", "5", "--json", "--log", "serve.log"
    )
    events(serving, "ready")
    for process in (serving, broker):
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=15)
    assert lines(tmp_path / "serve.log")[0]["event"] == "server_ready"
    assert lines(tmp_path / "serve.log")[0]["server"] == 5
    found = names(tmp_path / "broker.log")
    assert (found[0], found[-1]) == ("listening", "stopped")


@pytest.mark.slow
def test_what_the_broker_refuses_is_logged(start: Any, tmp_path: Path) -> None:
    import socket

    broker = start("broker", "--port", "0", "--json", "--log", "log")
    (listening,) = events(broker, "listening")
    with socket.create_connection(("127.0.0.1", listening["port"]), 5) as stranger:
        stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
        stranger.settimeout(5)
        while stranger.recv(100):
            pass
    broker.send_signal(signal.SIGTERM)
    broker.communicate(timeout=15)
    engine = [line for line in lines(tmp_path / "log") if line["event"] == "engine"]
    assert any("CONNECT" in line["message"] for line in engine)
    assert {line["part"] for line in engine} == {"swarmwright_broker"}


@pytest.mark.slow
def test_a_log_that_cannot_be_written_is_named(tmp_path: Path, program: Any) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    done = program("optimize", "e.yaml", "--servers", "local", "--log", "nowhere/log")
    assert done.returncode == 2
    assert "nowhere/log" in done.stderr
    with pytest.raises(InputError, match="nowhere"):
        Log(tmp_path / "nowhere" / "log")


@pytest.mark.slow
def test_a_log_that_can_no_longer_be_written_is_told_once(tmp_path: Path, program: Any) -> None:
    (tmp_path / "e.yaml").write_text(QUICK)
    done = program("optimize", "e.yaml", "--servers", "local", "--log", "/dev/full")
    assert done.returncode == 0
    assert done.stderr.count("warning: --log /dev/full: No space left on device") == 1


def test_a_log_says_what_it_lacks(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "log"
    place.symlink_to("/dev/full")
    with Log(place) as log:
        log.write("info", "one")
        log.write("info", "two")
        place.unlink()
        log.write("info", "three")
        log.write("info", "four")
    assert "No space left on device" in capfd.readouterr().err
    assert names(place) == ["log_gap", "three", "four"]
    assert lines(place)[0]["lines"] == 2


def test_numbers_that_json_has_not_become_null(tmp_path: Path) -> None:
    with Log(tmp_path / "log") as log:
        log.write("info", "x", a=float("nan"), b=None, c=Path("p"))
        log.write("debug", "unwanted")
    (line,) = lines(tmp_path / "log")
    assert (line["a"], line["c"]) == (None, "p")
    assert "b" not in line
