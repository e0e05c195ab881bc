import json
import os
import signal
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from tests.python.cli.processes import alive, gone

pytestmark = pytest.mark.slow


def events(process: Any, wanted: str, number: int = 1) -> list[dict[str, Any]]:
    """The next events of a kind from the program's JSON lines."""
    found: list[dict[str, Any]] = []
    while len(found) < number:
        line = process.stdout.readline()
        assert line, process.stderr.read()
        event = json.loads(line)
        if event["event"] == wanted:
            found.append(event)
    return found


def reachable(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1).close()
    except OSError:
        return False
    return True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_broker_runs_until_it_is_asked_to_end(start: Any, number: int) -> None:
    process = start("broker", "--port", "0", "--json")
    (listening,) = events(process, "listening")
    assert listening["url"] == f"mqtt://127.0.0.1:{listening['port']}"
    assert reachable(listening["port"])
    process.send_signal(number)
    _, err = process.communicate(timeout=10)
    assert process.returncode == 0
    assert err == ""
    assert not reachable(listening["port"])


@pytest.mark.parametrize(
    ("arguments", "begun"), [(("serve", "minisim"), "ready"), (("servers", "--watch"), None)]
)
def test_ctrl_c_is_the_normal_end_of_what_runs_until_then(
    start: Any, any_broker: str, arguments: tuple[str, ...], begun: str | None
) -> None:
    process = start(*arguments, "--broker", any_broker, "--json")
    if begun is None:
        process.stdout.readline()
    else:
        events(process, begun)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=15)
    assert process.returncode == 0
    assert err == ""


def test_a_port_in_use_is_named(start: Any, program: Any) -> None:
    (listening,) = events(start("broker", "--port", "0", "--json"), "listening")
    second = program("broker", "--port", listening["port"])
    assert second.returncode == 1
    assert str(listening["port"]) in second.stderr


def test_servers_are_listed_and_leave_with_their_supervisor(
    start: Any, program: Any, any_broker: str
) -> None:
    serving = start("serve", "minisim", "--broker", any_broker, "--id", "40", "--count", "3", "--json")
    ready = events(serving, "ready", 3)
    assert sorted(event["server"] for event in ready) == [40, 41, 42]
    listed = program("servers", "--broker", any_broker, "--json")
    assert listed.returncode == 0, listed.stderr
    servers = [json.loads(line) for line in listed.stdout.splitlines()]
    assert [(server["server"], server["state"]) for server in servers] == [
        (40, "ready"),
        (41, "ready"),
        (42, "ready"),
    ]
    assert all("minisim" in server["simulations"] for server in servers)
    table = program("servers", "--broker", any_broker)
    assert "40" in table.stdout
    assert "ready" in table.stdout
    serving.send_signal(signal.SIGTERM)
    _, err = serving.communicate(timeout=15)
    assert serving.returncode == 0, err
    for event in ready:
        assert not alive(event["pid"])
    empty = program("servers", "--broker", any_broker)
    assert empty.returncode == 0
    assert "No simulation server" in empty.stdout
    assert "swarmwright serve" in empty.stdout


def test_a_server_has_any_id_of_the_protocol(
    start: Any, program: Any, embedded_broker: str, tmp_path: Path
) -> None:
    last = 2**63 - 1
    serving = start(
        "serve", "minisim", "--broker", embedded_broker, "--id", str(last - 1), "--count", "2", "--json"
    )
    assert {event["server"] for event in events(serving, "ready", 2)} == {last - 1, last}
    (tmp_path / "x.yaml").write_text("simulation: minisim\nmethod: {population: 4, generations: 1}\n")
    for mode in ("stepwise", "offloaded"):
        words = ("--set", f"mode={mode}", "--out", mode, "--broker", embedded_broker)
        result = program("optimize", "x.yaml", *words)
        assert result.returncode == 0, result.stderr
    too_large = program("serve", "minisim", "--id", str(last), "--count", "2")
    assert too_large.returncode == 2
    assert f"passes the largest id, {last}" in too_large.stderr


def test_optimize_uses_the_servers_of_a_broker(
    start: Any, program: Any, any_broker: str, tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmode: stepwise\nmethod: {population: 50, generations: 40}\n"
    )
    serving = start("serve", "minisim", "--broker", any_broker, "--count", "2", "--json")
    events(serving, "ready", 2)
    result = program("optimize", "x.yaml", "--out", "result", env={"SWARMWRIGHT_BROKER": any_broker})
    assert result.returncode == 0, result.stderr
    used = {attempt.server for attempt in Run.open(tmp_path / "result").attempts()}
    assert len(used) == 2
    busy = events(serving, "busy")
    assert busy[0]["server"] in used


def test_the_prefix_of_the_environment_is_used_where_none_is_named(
    start: Any, program: Any, embedded_broker: str, tmp_path: Path
) -> None:
    where = {"SWARMWRIGHT_BROKER": embedded_broker}
    lab = {**where, "SWARMWRIGHT_PREFIX": "lab1"}
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {population: 4, generations: 1}\ntimeouts: {discovery: 1}\n"
    )
    events(start("serve", "minisim", "--id", "7", "--json", env=lab), "ready")
    listed = program("servers", "--json", env=lab)
    assert json.loads(listed.stdout)["server"] == 7
    run = program("optimize", "x.yaml", "--out", "run", env=lab)
    assert run.returncode == 0, run.stderr
    assert Run.open(tmp_path / "run").experiment.prefix == ""  # where it was evaluated does not matter
    assert {attempt.server for attempt in Run.open(tmp_path / "run").attempts()} == {7}
    # What names one wins.
    for more in (("--prefix", "lab2"), ("--set", "prefix=lab2"), ("--prefix", "")):
        other = program("optimize", "x.yaml", "--out", "other", *more, env=lab)
        assert "no server" in other.stderr, more
    wrong = program("optimize", "x.yaml", "--out", "other", env={**where, "SWARMWRIGHT_PREFIX": "a/#"})
    assert wrong.returncode == 2
    assert "SWARMWRIGHT_PREFIX (environment)" in wrong.stderr


@pytest.mark.timeout(240)
def test_every_command_with_a_broker_takes_a_prefix(
    start: Any, program: Any, embedded_broker: str, tmp_path: Path
) -> None:
    """Each finds the server under the prefix of the environment, and under that of its option."""
    lab, elsewhere = ({"SWARMWRIGHT_PREFIX": prefix} for prefix in ("lab1", "lab2"))
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {population: 4, generations: 1}\ntimeouts: {discovery: 5}\n"
        f"broker: {embedded_broker}\n"
    )
    (tmp_path / "sweep.yaml").write_text("experiment: x.yaml\nseeds: 1\n")
    (tmp_path / "other.yaml").write_text("parameters: {maxSteps: 5}\n")
    serving = ("serve", "minisim", "--broker", embedded_broker, "--id", "7", "--json")
    events(start(*serving, env=lab), "ready")
    assert program("optimize", "x.yaml", "--out", "run", env=lab).returncode == 0
    for number, command in enumerate(
        [
            ("evaluate", "run"),
            ("evaluate", "run", "--episodes", "2"),
            ("evaluate", "x.yaml", "--controller", "run/best.json", "--episodes", "2"),
            ("simulate", "x.yaml"),
            ("replay", "run", "--json", "--broker", embedded_broker),
            ("transfer", "run", "--to", "other.yaml", "--candidates", "1", "--seeds", "2"),
            ("transfer", "run", "--vary", "parameters.maxSteps=5..9", "--candidates", "1", "--seeds", "2"),
            ("sweep", "sweep.yaml"),
            ("resume", "run"),  # the last one: it records the option
        ]
    ):
        for way, (option, env) in enumerate((((), lab), (("--prefix", "lab1"), elsewhere))):
            more = {
                "resume": ("--generations", str(2 + way)),
                "sweep": ("--out", f"sweep{number}{way}"),
            }.get(command[0], ())
            done = program(*command, *more, *option, env=env)
            assert done.returncode == 0, (command, option, done.stderr)
    assert program("simulate", "x.yaml", env=elsewhere).returncode == 1


@pytest.mark.parametrize("servers", ["2", "process:2"])
def test_servers_of_a_run_have_its_prefix(
    program: Any, embedded_broker: str, tmp_path: Path, servers: str
) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\nmethod: {population: 4, generations: 1}\n")
    run = ("optimize", "x.yaml", "--servers", servers, "--broker", embedded_broker)
    for number, more in enumerate([(), ("--prefix", "lab2"), ("--prefix", "")]):
        done = program(*run, "--out", f"run{number}", *more, env={"SWARMWRIGHT_PREFIX": "lab1"})
        assert done.returncode == 0, (more, done.stderr)
    own = program(*run[:-2], "--out", "own", env={"SWARMWRIGHT_PREFIX": "lab1"})
    assert own.returncode == 0, own.stderr


def test_the_way_to_start_a_server_has_the_prefix(program: Any, embedded_broker: str) -> None:
    where = ("servers", "--broker", embedded_broker, "--wait", "0.1")
    account = {"SWARMWRIGHT_USERNAME": "ada", "SWARMWRIGHT_PASSWORD": "horse"}
    told = program(*where, "--prefix", "lab 1", env=account).stdout.splitlines()
    assert told[:3] == [
        f"No simulation server on {embedded_broker} under the prefix lab 1.",
        "An account that may not read this prefix sees no servers.",
        f"Start one with: swarmwright serve minisim --broker {embedded_broker} --prefix 'lab 1'",
    ]
    assert "account" not in program(*where).stdout


def test_lost_servers_are_forgotten(start: Any, program: Any, any_broker: str) -> None:
    serving = start("serve", "minisim", "--broker", any_broker, "--id", "60", "--count", "2", "--json")
    ready = {event["server"]: event["pid"] for event in events(serving, "ready", 2)}
    nothing = program("servers", "--broker", any_broker, "--forget-lost")
    assert (nothing.returncode, nothing.stdout) == (0, f"No server on {any_broker} is lost.\n")
    for pid in (serving.pid, *ready.values()):
        os.kill(pid, signal.SIGKILL)
    assert gone([serving.pid, *ready.values()])
    deadline = time.monotonic() + 10
    while program("servers", "--broker", any_broker).stdout.count("lost") < 2:
        assert time.monotonic() < deadline
    done = program("servers", "--broker", any_broker, "--forget-lost")
    assert done.returncode == 0, done.stderr
    host = socket.gethostname()
    assert done.stdout.splitlines() == [
        f"server {server} ({host}/{ready[server]}) is forgotten" for server in (60, 61)
    ]
    assert "No simulation server" in program("servers", "--broker", any_broker).stdout


def test_a_dying_server_is_reported_and_started_again(start: Any, program: Any, embedded_broker: str) -> None:
    serving = start("serve", "minisim", "--broker", embedded_broker, "--id", "50", "--count", "2", "--json")
    ready = {event["server"]: event["pid"] for event in events(serving, "ready", 2)}
    os.kill(ready[50], signal.SIGKILL)
    (ended,) = events(serving, "ended")
    assert (ended["server"], ended["status"]) == (50, -9)
    assert ended["restart"] < 1
    (again,) = events(serving, "ready")
    assert again["server"] == 50
    assert again["pid"] != ready[50]
    listed = program("servers", "--broker", embedded_broker, "--json")
    states = {json.loads(line)["server"]: json.loads(line)["state"] for line in listed.stdout.splitlines()}
    assert states == {50: "ready", 51: "ready"}
    serving.send_signal(signal.SIGTERM)
    _, err = serving.communicate(timeout=15)
    assert "server 50" in err
    assert "SIGKILL" in err
    assert serving.returncode == 1, "something went wrong on the way"
    assert gone([again["pid"], ready[51]])


def test_servers_end_with_a_supervisor_that_is_killed(start: Any, embedded_broker: str) -> None:
    serving = start("serve", "minisim", "--broker", embedded_broker, "--count", "2", "--json")
    pids = [event["pid"] for event in events(serving, "ready", 2)]
    serving.kill()
    serving.wait(10)
    assert gone(pids)


def test_no_broker_there(program: Any, unused_port: int) -> None:
    url = f"mqtt://127.0.0.1:{unused_port}"
    for arguments in (["serve", "minisim"], ["servers"]):
        result = program(*arguments, "--broker", url)
        assert result.returncode == 1
        assert str(unused_port) in result.stderr


def test_unknown_simulations_are_answered_with_what_there_is(program: Any) -> None:
    result = program("serve", "minisym")
    assert result.returncode == 2
    assert "did you mean 'minisim'" in result.stderr


def test_an_id_that_is_taken(start: Any, program: Any, embedded_broker: str) -> None:
    events(start("serve", "minisim", "--broker", embedded_broker, "--id", "9", "--json"), "ready")
    second = program("serve", "minisim", "--broker", embedded_broker, "--id", "9")
    assert second.returncode == 1
    assert "9" in second.stderr
