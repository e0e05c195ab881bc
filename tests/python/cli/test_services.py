import json
import os
import signal
import socket
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from tests.python.cli.processes import alive, gone


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
