"""Brokers at Unix sockets: the same record as over TCP, and what is wrong with a file is named."""

import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.brokers import KINDS, Kind
from tests.system.conftest import EXPERIMENT, Experiment, Launch, ServeCpp
from tests.system.processes import Program
from tests.system.runs import attempts, record


def mosquitto(folder: Path, path: Path, cleanup: ExitStack) -> None:
    """Start a Mosquitto at a Unix socket, and wait until it listens."""
    binary = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    assert binary, "mosquitto is missing; `make test` installs it"
    lines = [f"listener 0 {path}", "allow_anonymous true", "max_queued_messages 0"]
    if os.getuid() == 0:
        lines.insert(0, "user root")
    configuration = folder / "mosquitto.conf"
    configuration.write_text("\n".join(lines) + "\n")
    process = subprocess.Popen([binary, "-c", str(configuration)], stderr=subprocess.DEVNULL)
    cleanup.callback(process.wait, 10)
    cleanup.callback(process.terminate)
    deadline = time.monotonic() + 15
    while not path.exists():
        assert process.poll() is None, "mosquitto ended"
        assert time.monotonic() < deadline, "mosquitto does not listen"
        time.sleep(0.02)


@pytest.mark.journey
@pytest.mark.parametrize("kind", KINDS)
def test_a_run_with_two_servers_has_the_record_of_one_over_tcp(
    kind: Kind, launch: Launch, experiment: Experiment, tmp_path: Path, cleanup: ExitStack
) -> None:
    path = experiment(f"{EXPERIMENT}mode: stepwise\n")
    over_tcp = launch("optimize", path, "--servers", 2, "--out", "tcp")
    file = tmp_path / "broker.sock"
    url = f"unix://{file}"
    # They may start before their broker.
    servers = launch("serve", "minisim", "--count", 2, "--wait", 60, "--broker", url, "--json")
    assert "the file does not exist" in servers.until_event("waiting")["message"]
    if kind == "mosquitto":
        mosquitto(tmp_path, file, cleanup)
    else:
        launch("broker", "--socket", file.name, "--json").until_event("listening")
    servers.until_event("ready", 2)
    # The run over TCP may not have read its own file yet.
    run = launch(
        "optimize", experiment(f"{path.read_text()}broker: {url}\n", "socket.yaml"), "--out", "socket"
    )
    assert run.wait() == 0, run.stderr
    assert over_tcp.wait() == 0, over_tcp.stderr
    assert record(tmp_path / "socket") == record(tmp_path / "tcp")
    assert len({attempt["server"] for attempt in attempts(tmp_path / "socket")}) == 2
    shown = launch("servers", "--broker", url, "--json")
    assert shown.wait() == 0, shown.stderr


@pytest.mark.timeout(600)  # it may be the first that builds the library
def test_servers_in_cpp_connect_too(
    launch: Launch, serve_cpp: ServeCpp, experiment: Experiment, tmp_path: Path
) -> None:
    url = launch("broker", "--socket", "broker.sock", "--json").until_event("listening")["url"]
    serve_cpp(url)
    path = experiment(f"{EXPERIMENT}mode: offloaded\n")
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    run = launch("optimize", path, "--broker", url, "--out", "result")
    assert run.wait() == 0, run.stderr
    assert local.wait() == 0, local.stderr
    assert record(tmp_path / "result") == record(tmp_path / "local")


def test_a_run_goes_on_at_the_next_address_of_a_list(
    launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    method = "{kind: nnga, population: 16, generations: 40}"
    path = experiment(f"simulation: minisim\nmethod: {method}\nmode: stepwise\n")
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    near = launch("broker", "--socket", "broker.sock", "--json")
    far = launch("broker", "--port", 0, "--json")
    urls = ",".join(broker.until_event("listening")["url"] for broker in (near, far))
    servers = launch("serve", "minisim", "--count", 2, "--broker", urls, "--json")
    servers.until_event("ready", 2)
    run = launch("optimize", path, "--broker", urls, "--out", "result", "--json")
    run.until(lambda program: "best_so_far" in "".join(program.lines), "a generation")
    near.signal(signal.SIGKILL)
    assert run.wait(60) == 0, run.stderr
    assert local.wait() == 0, local.stderr
    assert record(tmp_path / "result") == record(tmp_path / "local")
    # Its file was left behind, which is no reason not to start.
    near.wait()
    assert (tmp_path / "broker.sock").exists()
    launch("broker", "--socket", "broker.sock", "--json").until_event("listening")


def test_the_file_of_the_embedded_broker(launch: Launch, tmp_path: Path) -> None:
    file = tmp_path / "broker.sock"
    broker = launch("broker", "--socket", file, "--port", 0, "--socket-mode", "660", "--json")
    listening = broker.until_event("listening")
    assert listening["socket"] == f"unix://{file}"
    assert listening["url"] == f"mqtt://127.0.0.1:{listening['port']}"
    assert stat.S_IMODE(file.stat().st_mode) == 0o660
    second = launch("broker", "--socket", file)
    assert second.wait() == 1
    assert f"Unix socket {file}: another broker listens there" in second.stderr
    broker.signal(signal.SIGINT)
    broker.wait()
    assert not file.exists()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("servers", "--broker", "unix://{folder}/missing"), 1, "the file does not exist"),
        (("servers", "--broker", "unix://broker.sock"), 2, "absolute path of a Unix socket"),
        (("servers", "--broker", "unix:///{long}"), 2, "has a path of 121 bytes"),
        (("broker", "--socket", "{long}"), 1, "choose a shorter path"),
        (("broker", "--socket", "{folder}/missing/broker.sock"), 1, "missing does not exist; create it"),
        (("broker", "--socket", "x", "--socket-mode", "rw"), 2, "write three octal digits, such as 660"),
        (("broker", "--socket-mode", "660"), 2, "--socket-mode needs --socket; add it"),
        (
            ("optimize", "{experiment}", "--servers", "slurm:2", "--broker", "unix:///run/x"),
            2,
            "servers of slurm run on other machines, which cannot use a Unix socket",
        ),
    ],
)
def test_mistakes_are_named(
    arguments: tuple[str, ...],
    status: int,
    words: str,
    launch: Launch,
    experiment: Experiment,
    tmp_path: Path,
) -> None:
    values = {"folder": tmp_path, "long": "x" * 120, "experiment": experiment()}
    program = launch(*(argument.format(**values) for argument in arguments))
    assert program.wait() == status, program.stderr
    assert words in program.stderr


CONNECT = """\
import os, sys
from swarmwright import _engine
if os.getuid() == 0:
    os.setuid(65534)
try:
    _engine.servers(sys.argv[1])
except _engine.NoBrokerError:
    sys.exit("it would be waited for")
except _engine.EngineError as error:
    sys.exit(str(error))
"""


def test_a_socket_of_another_user_is_not_waited_for(launch: Launch, tmp_path: Path) -> None:
    url = launch("broker", "--socket", "broker.sock", "--json").until_event("listening")["url"]
    (tmp_path / "broker.sock").chmod(0)  # root may open it nevertheless, and becomes another user
    client = Program("-c", CONNECT, url, cwd=tmp_path, program=[sys.executable])
    assert client.wait() == 1
    assert f"this user may not open the broker's socket {url}" in client.stderr
