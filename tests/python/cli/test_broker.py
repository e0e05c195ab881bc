"""`swarmwright broker`: who is let in, and the files that it writes."""

import json
import os
import pty
import re
import signal
import socket
import stat
import subprocess
import time
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from tests.conftest import PROGRAM, environment
from tests.python.cli.test_services import events

pytestmark = pytest.mark.slow


def add_user(folder: Path, file: str, name: str, password: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*PROGRAM, "broker", "--add-user", file, name],
        cwd=folder,
        env=environment(),
        input=password,
        text=True,
        capture_output=True,
        timeout=20,
        check=False,
    )


def test_only_those_with_the_password_are_let_in(start: Any, program: Any, tmp_path: Path) -> None:
    added = add_user(tmp_path, "users.txt", "lab", "correct horse\n")
    assert (added.returncode, added.stdout) == (0, "users.txt: lab added\n")
    (tmp_path / "secret").write_text("correct horse\n")
    (listening,) = events(start("broker", "--port", "0", "--users", "users.txt", "--json"), "listening")
    url = listening["url"]
    without = program("servers", "--broker", url)
    assert without.returncode == 1
    assert "SWARMWRIGHT_PASSWORD" in without.stderr
    lab = {"SWARMWRIGHT_USERNAME": "lab"}
    wrong = program("servers", "--broker", url, env={**lab, "SWARMWRIGHT_PASSWORD": "battery"})
    assert wrong.returncode == 1
    assert "battery" not in wrong.stderr
    right = {**lab, "SWARMWRIGHT_PASSWORD_FILE": str(tmp_path / "secret")}
    assert program("servers", "--broker", url, env=right).returncode == 0


def test_a_password_that_can_be_read_is_refused(program: Any, tmp_path: Path) -> None:
    (tmp_path / "users.txt").write_text("# ours\nlab:correct horse\n")
    result = program("broker", "--port", "0", "--users", "users.txt")
    assert result.returncode == 1
    for word in ("users.txt", "line 2", "--add-user"):
        assert word in result.stderr
    assert "correct horse" not in result.stderr


def test_a_password_typed_on_a_terminal_is_not_shown(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [*PROGRAM, "broker", "--add-user", "users.txt", "ada"]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=environment(),
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    )
    os.close(theirs)
    shown = b""
    for prompt in (b"Password of ada", b"Repeat"):
        deadline = time.monotonic() + 20
        while prompt not in shown and time.monotonic() < deadline:
            shown += os.read(ours, 1024)
        time.sleep(0.1)
        os.write(ours, b"correct horse\n")
    while b"added" not in shown:
        shown += os.read(ours, 1024)
    assert process.wait(20) == 0
    os.close(ours)
    assert b"correct horse" not in shown
    assert (tmp_path / "users.txt").read_text().startswith("ada:$argon2id$")


@pytest.mark.parametrize("password", ["", "\n"])
def test_no_password_is_none(tmp_path: Path, password: str) -> None:
    result = add_user(tmp_path, "users.txt", "ada", password)
    assert result.returncode == 2
    assert "standard input" in result.stderr
    assert not list(tmp_path.iterdir())


def test_what_to_do_next_are_three_commands(program: Any, tmp_path: Path) -> None:
    made = program("broker", "--init", "my lab", "--host", "broker.example", "--prefix", "a/b")
    assert made.returncode == 0
    commands = [line for line in made.stdout.splitlines() if line.startswith("  ")]
    assert commands == [
        "  mosquitto -c 'my lab/mosquitto.conf'",
        "  . 'my lab/a-b-server.env' && swarmwright serve minisim",
        "  . 'my lab/a-b-tool.env' && swarmwright optimize EXPERIMENT.yaml",
    ]
    again = program("broker", "--init", "my lab", "--host", "broker.example", "--prefix", "a/b")
    assert again.returncode != 0
    assert "not overwritten" in again.stderr
    for path in (tmp_path / "my lab").glob("*.password"):
        assert path.read_text().strip() not in made.stdout


def test_a_group_is_added_to_a_broker(program: Any, tmp_path: Path) -> None:
    program("broker", "--init", "lab", "--host", "broker.example", "--prefix", "a")
    before = {path.name: path.read_bytes() for path in (tmp_path / "lab").iterdir()}
    again = program("broker", "--init", "lab", "--host", "broker.example", "--prefix", "b")
    assert again.returncode == 2
    assert "`--prefix P` alone adds accounts" in again.stderr
    assert {path.name: path.read_bytes() for path in (tmp_path / "lab").iterdir()} == before
    added = program("broker", "--init", "lab", "--prefix", "b")
    assert added.returncode == 0, added.stderr
    assert added.stdout.splitlines() == [
        "lab: the users b-tool, b-server, b-watcher were added",
        "Send SIGHUP to the broker to load them:",
        "  kill -HUP $(pidof mosquitto)",
    ]
    assert "mqtts://broker.example:8883" in (tmp_path / "lab" / "b-tool.env").read_text()
    twice = program("broker", "--init", "lab", "--prefix", "b", "--json")
    assert twice.returncode == 2
    assert "not overwritten" in twice.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--host", "0.0.0.0", "--users", "f"], ["--certificate", "be read on the network path"]),
        (["--host", "0.0.0.0", "--certificate", "f", "--key", "f"], ["--users", "without a password"]),
        (["--access", "f"], ["--users"]),
        (["--prefix", "a"], ["--init"]),
        (["--host", "127.0.0.1", "--host", "127.0.0.2"], ["one address"]),
        (["--init", "x", "--users", "f"], ["--init and --users exclude each other"]),
        (["--init", "x", "--add-user", "f", "ada"], ["--add-user"]),
        (["--init", "x", "--port", "0"], ["8883"]),
        (["--add-user", "f", "ada", "--key", "f"], ["--key"]),
        (["--origin", "http://localhost:8000"], ["--websocket-port"]),
        (["--iterations", "5000"], ["--init"]),
    ],
)
def test_what_does_not_go_together(
    program: Any, tmp_path: Path, arguments: list[str], words: list[str]
) -> None:
    (tmp_path / "f").write_text("")
    result = program("broker", *arguments)
    assert result.returncode == 2
    for word in words:
        assert word.lower() in result.stderr.lower()
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_a_new_password_file_is_private_and_one_that_is_not_is_warned_of(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        assert add_user(tmp_path, "users.txt", "ada", "correct horse\n").stderr == ""
        assert stat.S_IMODE((tmp_path / "users.txt").stat().st_mode) == 0o600
        (tmp_path / "users.txt").chmod(0o644)
        again = add_user(tmp_path, "users.txt", "bob", "correct horse\n")
    finally:
        os.umask(before)
    assert again.returncode == 0
    assert "users.txt can be read by every user" in again.stderr
    assert "chmod 600" in again.stderr


def test_the_log_says_whose_message_was_denied(start: Any, tmp_path: Path) -> None:
    add_user(tmp_path, "users.txt", "ada", "correct horse\n")
    (tmp_path / "access.txt").write_text("user ada\ntopic write allowed\n")
    rules = ("--users", "users.txt", "--access", "access.txt")
    broker = start("broker", "--port", "0", *rules, "--json", "--log", "broker.log")
    (listening,) = events(broker, "listening")
    port = int(listening["url"].rsplit(":", 1)[1])
    client = mqtt.Client(CallbackAPIVersion.VERSION2, "probe")
    client.username_pw_set("ada", "correct horse")
    client.connect("127.0.0.1", port)
    client.loop_start()
    for topic in ("control", "allowed"):
        client.publish(topic, "x", qos=1).wait_for_publish(20)
    client.disconnect()
    client.loop_stop()
    broker.terminate()
    assert broker.wait(20) == 0
    logged = [
        json.loads(line).get("message", "") for line in (tmp_path / "broker.log").read_text().splitlines()
    ]
    (denied,) = (message for message in logged if "may not publish" in message)
    assert re.search(r"client probe of account ada at 127.0.0.1:\d+: may not publish to control", denied)


@pytest.mark.journey
def test_sighup_has_files_read_again_and_ends_nothing(start: Any, program: Any, tmp_path: Path) -> None:
    add_user(tmp_path, "users.txt", "ada", "correct horse\n")
    broker = start("broker", "--port", "0", "--users", "users.txt", "--json", "--log", "broker.log")
    (listening,) = events(broker, "listening")

    def enters(user: str) -> bool:
        login = {"SWARMWRIGHT_USERNAME": user, "SWARMWRIGHT_PASSWORD": "correct horse"}
        return bool(program("servers", "--broker", listening["url"], env=login).returncode == 0)

    assert enters("ada")
    assert not enters("bob")
    good = (tmp_path / "users.txt").read_text()
    (tmp_path / "users.txt").write_text(good + "bob:battery\n")
    broker.send_signal(signal.SIGHUP)
    (failed,) = events(broker, "reload_failed")
    assert "users.txt, line 2" in failed["message"]
    assert "battery" not in failed["message"]
    assert enters("ada")
    (tmp_path / "users.txt").write_text("bob:" + good.split(":", 1)[1])
    broker.send_signal(signal.SIGHUP)
    events(broker, "reloaded")
    assert enters("bob")
    assert not enters("ada")
    broker.terminate()
    assert broker.wait(20) == 0
    logged = [json.loads(line) for line in (tmp_path / "broker.log").read_text().splitlines()]
    names = [line["event"] for line in logged]
    assert "reloaded" in names
    (wrong,) = [line["message"] for line in logged if "old settings stay in use" in line.get("message", "")]
    assert "line 2" in wrong


def test_a_broker_whose_terminal_goes_ends(tmp_path: Path) -> None:
    """A hang-up is no request to read files again: nobody could stop that broker with Ctrl-C any more."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(tmp_path)
        os.execve(PROGRAM[0], [*PROGRAM, "broker", "--port", "0"], environment())
    shown = b""
    while b"listens" not in shown:
        shown += os.read(terminal, 1024)
    os.kill(pid, signal.SIGHUP)
    while b"Reloaded" not in shown:
        shown += os.read(terminal, 1024)
    os.close(terminal)
    deadline = time.monotonic() + 20
    ended, status = 0, 0
    while not ended and time.monotonic() < deadline:
        time.sleep(0.1)
        ended, status = os.waitpid(pid, os.WNOHANG)
    if not ended:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    assert ended
    assert not os.WIFSIGNALED(status)


@pytest.mark.parametrize(
    ("options", "origin", "status"),
    [
        ((), None, 101),
        ((), "http://localhost:8000", 101),
        ((), "http://evil.example", 403),
        (("--origin", "https://dash.example"), "https://dash.example", 101),
        (("--origin", "https://dash.example"), "http://evil.example", 403),
    ],
)
def test_web_pages_of_other_hosts_may_not_connect(
    start: Any, options: tuple[str, ...], origin: str | None, status: int
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    broker = start("broker", "--port", "0", "--websocket-port", str(port), "--json", *options)
    events(broker, "listening")
    lines = [
        "GET /mqtt HTTP/1.1",
        f"Host: localhost:{port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Protocol: mqtt",
        *([] if origin is None else [f"Origin: {origin}"]),
    ]
    with socket.create_connection(("127.0.0.1", port), 10) as client:
        client.sendall("\r\n".join([*lines, "", ""]).encode())
        answer = client.recv(4096).decode()
    assert answer.startswith(f"HTTP/1.1 {status} ")
    assert ("--origin http://evil.example" in answer) == (status == 403)


def test_a_log_that_grows_is_bounded(start: Any, tmp_path: Path) -> None:
    """What others make the broker write fills no disk; a file that logrotate moved away is begun anew."""
    log = tmp_path / "broker.log"
    log.write_text("{}\n" * 349_000)  # just below 1 MiB
    broker = start("broker", "--port", "0", "--json", "--log", "broker.log", "--log-size", "1")
    (listening,) = events(broker, "listening")
    knocks = 0
    while not (tmp_path / "broker.log.1").exists() and knocks < 2000:
        with socket.create_connection(("127.0.0.1", listening["port"]), 10) as client:
            client.sendall(b"GET / HTTP/1.1\r\n\r\n")
            client.recv(100)
        knocks += 1
        if knocks % 20 == 0:
            time.sleep(0.5)
    assert (tmp_path / "broker.log.1").stat().st_size <= 1 << 20
    assert log.stat().st_size < 100_000
    log.rename(tmp_path / "moved")
    broker.terminate()
    assert broker.wait(20) == 0
    assert json.loads(log.read_text().splitlines()[-1])["event"] == "stopped"


def test_all_addresses_are_called_so(start: Any, program: Any) -> None:
    assert program("broker", "--init", "lab", "--host", "localhost", "--iterations", "1000").returncode == 0
    files = [
        ("users", "passwords"),
        ("access", "acl"),
        ("certificate", "broker.pem"),
        ("key", "broker-key.pem"),
    ]
    given = [word for name, file in files for word in (f"--{name}", f"lab/{file}")]
    process = start("broker", "--host", "0.0.0.0", "--port", "0", *given)
    said = process.stdout.readline()
    assert said.startswith("The broker listens on all addresses of this machine, here mqtts://127.0.0.1:")


def test_the_certificate_of_an_authority_is_warned_of(start: Any, program: Any) -> None:
    """As `openssl req -x509` makes it; clients refuse it."""
    assert program("broker", "--init", "lab", "--host", "localhost", "--iterations", "1000").returncode == 0
    given = ["--certificate", "lab/ca.pem", "--key", "lab/ca-key.pem"]
    process = start("broker", "--port", "0", *given)
    process.stdout.readline()
    process.terminate()
    _, said = process.communicate(timeout=20)
    assert "lab/ca.pem is the certificate of an authority (CA:TRUE)" in said
    assert "--init" in said
