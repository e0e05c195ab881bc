"""Warnings of a run: the first of each kind, then how many more."""

import json
import math
import signal
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, Run
from swarmwright.cli._observing import Log, Warnings
from tests.python.cli.test_services import events

MORE = "more warnings of the same kind"
FRAGILE = """\
import numpy as np
from swarmwright import Simulation

class Fragile(Simulation):
    title, dimensions, sensors, actuators = "fragile", 1, 1, 1

    def reset(self, parameters, seed):
        self.x, self.left = 0.0, 5
        return np.array([[0.0]])

    def step(self, actions):
        self.x, self.left = self.x + float(actions[0, 0]), self.left - 1
        if self.x > 1:
            raise ValueError("the wheel came off")
        return np.array([[self.x]])

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.x
"""


@pytest.mark.slow
def test_what_fails_again_and_again_is_told_once_and_counted(program: Any, tmp_path: Path) -> None:
    (tmp_path / "fragile.py").write_text(FRAGILE)
    experiment = tmp_path / "fragile.yaml"
    experiment.write_text(
        "simulation: fragile.py:Fragile\nservers: 1\nseed: 1\n"
        "method: {kind: random_search, population: 60, generations: 4}\n"
    )
    done = program("optimize", "fragile.yaml", "--out", "run", "--log", "log", "--json")
    assert done.returncode == 0, done.stderr
    result = Run.open(tmp_path / "run")
    reasons = [attempt.error for attempt in result.attempts() if attempt.error]
    failed = int((result.record.episodes != result.record.episodes).sum())
    assert len(reasons) == 3 * failed > 20, "nothing of it is lost"
    reason = "Fragile.step: ValueError: the wheel came off (fragile.py:14)"
    assert set(reasons) == {reason}
    lines = [line for line in done.stderr.splitlines() if "failed" in line]
    once = f"an evaluation failed after 3 attempts: {reason}"
    (hint,) = (line for line in lines if "repeat it" in line)
    lines.remove(hint)
    assert lines[1:] == [f"swarmwright: {once}", f"swarmwright: {failed - 1} {MORE}: {once}"]
    # Which candidate it was is in the record, and how it is evaluated again is told once.
    warnings = [event for event in result.events() if event.kind == "warning"]
    first = next(event for event in warnings if event.text.startswith("candidate "))
    assert first.text.endswith(f", episode 0 (seed 0) failed after 3 attempts: {reason}")
    candidate = first.text.split(",")[0]
    assert math.isnan(result.evaluation(int(candidate.split()[1]), first.generation).episodes[0])
    how = f"--candidate {first.generation}:{candidate.split()[1]}"
    assert f"swarmwright evaluate {tmp_path / 'run'} {how}; " in hint
    assert hint.startswith(
        f"swarmwright: generation {first.generation}, {candidate}, episode 0 (seed 0) failed"
    )
    assert not any(event.text.startswith("an evaluation failed") for event in warnings)
    again = program("evaluate", "run", *how.split())
    assert "an episode failed: Fragile.step: ValueError: the wheel came off" in again.stderr
    logged = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    told = [line["message"] for line in logged if line["event"] == "warning"]
    told = [line for line in told if "repeat it" not in line]
    assert told[1:] == [once, f"{failed - 1} {MORE}: {once}"]


def test_lines_that_differ_in_numbers_alone_are_of_one_kind(capsys: pytest.CaptureFixture[str]) -> None:
    warnings = Warnings()
    for server in range(1, 5):
        warnings.report({"event": "warning", "message": f"server {server} is silent for {server}.5 s"})
    warnings.report({"event": "broker_lost", "reason": "end of file"})
    warnings.report({"event": "broker_back"})
    warnings.report({"event": "warning", "message": f"7 {MORE}: counted already"})
    warnings.close()
    warnings.close()
    assert capsys.readouterr().err.splitlines() == [
        "swarmwright: server 1 is silent for 1.5 s",
        "swarmwright: lost the broker (end of file); trying again",
        "swarmwright: the broker is back",
        f"swarmwright: 7 {MORE}: counted already",
        f"swarmwright: 3 {MORE} (server 2: 1, server 3: 1, server 4: 1): a server is silent for 1.5 s",
    ]


def test_repetitions_are_counted_by_reason_and_server(capsys: pytest.CaptureFixture[str]) -> None:
    """Neither the server, nor a path, nor the number of attempts makes another kind, the exit status does."""
    warnings = Warnings()

    def fails(server: int, reason: str, before: str = "") -> None:
        message = f"{before}an episode failed on server {server}: sim: {reason}"
        warnings.report({"event": "warning", "message": message})

    fails(1, "was ended by SIGABRT; see /tmp/instance-0/failed-7a")
    for server, count in ((1, 4), (2, 2), (1, 3)):
        before = f"{count} {MORE}: "
        fails(server, f"was ended by SIGABRT; see /tmp/instance-{server}/failed-8b", before)
    for status in (3, 4):
        fails(2, f"ended with exit status {status}")
    for attempts in (3, 2, 2):
        message = f"an evaluation failed after {attempts} attempts: no licence"
        warnings.report({"event": "warning", "message": message})
    warnings.close()
    reason = "sim: was ended by SIGABRT; see /tmp/instance-0/failed-7a"
    assert capsys.readouterr().err.splitlines() == [
        f"swarmwright: an episode failed on server 1: {reason}",
        "swarmwright: an episode failed on server 2: sim: ended with exit status 3",
        "swarmwright: an episode failed on server 2: sim: ended with exit status 4",
        "swarmwright: an evaluation failed after 3 attempts: no licence",
        f"swarmwright: 9 {MORE} (server 1: 7, server 2: 2): an episode failed on a server: {reason}",
        f"swarmwright: 2 {MORE}: an evaluation failed after 3 attempts: no licence",
    ]


def test_counts_come_less_and_less_often(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr("swarmwright.cli._observing.time.monotonic", lambda: now)
    warnings = Warnings()
    told = []
    for second in range(101):
        now = float(second)
        warnings.report({"event": "warning", "message": "no licence"})
        if MORE in capsys.readouterr().err:
            told.append(second)
    assert told == [10, 30, 70]


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
