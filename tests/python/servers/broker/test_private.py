"""Brokers that admit programs of their user alone: what another user of the machine can do with them."""

import json
import os
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, _engine
from swarmwright.common.errors import RunError, engine_errors
from swarmwright.servers.broker.credentials import location_of
from swarmwright.servers.broker.private import start_private
from swarmwright.servers.evaluation.launched.servers import start_embedded
from swarmwright.servers.evaluation.opening import open_backend
from tests.conftest import STATE
from tests.python.cli.test_services import events

NOBODY = 65534

# Another user's attempts. The interpreter, which that user may not be able to read, is loaded before.
STRANGER = """
import encodings.idna, glob, json, os, socket, sys
port, folder, words = int(sys.argv[1]), sys.argv[2], sys.argv[3:]
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)

def connack(user=None, password=None):
    text = lambda word: len(word).to_bytes(2, "big") + word.encode()
    login = b"" if user is None else text(user) + text(password)
    body = text("MQTT") + bytes([5, 2 | (0 if user is None else 0xC0), 0, 60, 0]) + text("stranger") + login
    with socket.create_connection(("127.0.0.1", port), 10) as client:
        client.sendall(bytes([0x10, len(body)]) + body)
        return client.recv(4)[3]

def readable(pattern):
    found = []
    for path in glob.glob(pattern, recursive=True):
        try:
            text = open(path, "rb").read()
        except OSError:
            continue
        found += [path for word in words if word.encode() in text]
    return found

codes = [connack(), connack("swarmwright", ""), connack("tool", "password"), connack("", "")]
processes = readable("/proc/[0-9]*/cmdline") + readable("/proc/[0-9]*/environ")
print(json.dumps({"codes": codes, "found": processes + readable(folder + "/**")}))
"""


def stranger(port: int, folder: Path, *words: str) -> dict[str, Any]:
    """CONNACK codes that another user gets from a broker, and files where that user finds these words."""
    # The words are not arguments: that user could read them there.
    script = STRANGER.replace("sys.argv[3:]", repr(list(words)))
    done = subprocess.run(
        [sys.executable, "-", str(port), str(folder)],
        input=script,
        capture_output=True,
        text=True,
        check=False,
        timeout=40,
    )
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def port_of(address: str) -> int:
    return int(location_of(address).rpartition(":")[2])


needs_root = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")


@pytest.fixture
def experiment() -> Experiment:
    return Experiment.from_mapping(
        {"simulation": "minisim", "method": {"kind": "nnga", "population": 4, "generations": 1}}
    )


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """A state folder whose parents every user may enter."""
    folder = tmp_path / "state"
    folder.mkdir()
    for parent in (folder, *folder.parents):
        if parent.stat().st_uid == os.getuid() and parent != parent.parent:
            parent.chmod(parent.stat().st_mode | stat.S_IXOTH | stat.S_IROTH)
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    yield folder
    assert not [*folder.glob("**/*.env")], "the file ends with its broker"


@pytest.mark.slow
@needs_root
def test_another_user_cannot_use_the_broker_of_a_run(experiment: Experiment, world: Path) -> None:
    with open_backend(experiment, servers=2) as backend:
        address = backend.description.rpartition(" ")[2]
        username, password = _engine.account(address)
        assert username
        assert password
        assert len(password) >= 43
        told = stranger(port_of(address), world, password, username)
    assert told == {"codes": [0x87] * 4, "found": []}


@pytest.mark.slow
@needs_root
def test_another_user_cannot_use_the_broker_of_launched_processes(world: Path) -> None:
    run = Experiment.from_mapping({"simulation": "minisim", "servers": {"launcher": "process", "count": 1}})
    with open_backend(run) as backend:
        address = backend.description.partition(": ")[0].rpartition(" ")[2]
        username, password = _engine.account(address)
        assert username
        assert password
        told = stranger(port_of(address), world, password, username)
    assert told == {"codes": [0x87] * 4, "found": []}


@pytest.mark.slow
@needs_root
def test_another_user_cannot_use_a_broker_that_runs_by_itself(start: Any, world: Path) -> None:
    broker = start(
        "broker",
        "--port",
        "0",
        "--websocket-port",
        "0",
        "--account",
        "me.env",
        "--json",
        env={"XDG_STATE_HOME": str(world)},
    )
    (listening,) = events(broker, "listening")
    username, password = _engine.account(listening["url"])
    assert username
    assert password
    told = stranger(listening["port"], world.parent, password, username)
    assert told == {"codes": [0x87] * 4, "found": []}
    broker.send_signal(signal.SIGINT)
    assert broker.wait(10) == 0


@pytest.mark.slow
def test_programs_of_one_user_find_a_broker_by_its_address(start: Any, program: Any, tmp_path: Path) -> None:
    broker = start("broker", "--port", "0", "--json")
    (listening,) = events(broker, "listening")
    server = start("serve", "minisim", "--broker", listening["url"], "--id", "7", "--json")
    events(server, "ready")
    # An account for another broker does not matter, and neither does the name of the host.
    login = {"SWARMWRIGHT_USERNAME": "lab", "SWARMWRIGHT_PASSWORD": "of the lab"}
    url = f"mqtt://localhost:{listening['port']}"
    found = program("servers", "--broker", url, env=login)
    assert found.returncode == 0, found.stderr
    assert "minisim" in found.stdout
    elsewhere = program("servers", "--broker", url, env={"XDG_STATE_HOME": str(tmp_path)})
    assert elsewhere.returncode == 1
    assert "refuses a client without a user name" in elsewhere.stderr
    assert "such as `swarmwright broker --account FILE` writes" in elsewhere.stderr


@pytest.mark.slow
def test_the_account_of_a_broker_that_was_killed_is_not_used(start: Any) -> None:
    broker = start("broker", "--port", "0", "--json")
    (listening,) = events(broker, "listening")
    (file,) = Path(STATE).glob(f"swarmwright/brokers/*/127.0.0.1-{listening['port']}.env")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert _engine.account(listening["url"])[0] is not None
    broker.kill()
    broker.wait(10)
    assert file.exists()
    assert _engine.account(listening["url"]) == (None, None)
    with ExitStack() as stack:
        start_private(stack)
        assert not file.exists(), "the next start removes it"


@pytest.mark.slow
def test_an_account_is_known_to_this_process_where_no_file_can_be_written(
    monkeypatch: pytest.MonkeyPatch, experiment: Experiment, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with open_backend(experiment, servers=1) as backend:
        assert _engine.account(backend.description.rpartition(" ")[2])[0] is not None


def test_the_broker_of_local_launchers_has_an_account() -> None:
    with ExitStack() as stack:
        access = start_embedded(stack, ["127.0.0.1"], ["process", "slurm"], port=None, prefix="")
        assert {one.username for one in access.servers.values()} != {None}
        assert set(access.servers) == {"process", "slurm"}
        account = access.servers["slurm"]
        assert (account.username, account.password) == _engine.account(access.address)
    with pytest.raises(RunError), engine_errors():
        _engine.servers(access.address, wait=0.1)


@pytest.mark.slow
def test_the_file_of_an_account_is_for_other_programs(start: Any, program: Any, tmp_path: Path) -> None:
    file = tmp_path / "me.env"
    broker = start("broker", "--port", "0", "--account", "me.env", "--json")
    (listening,) = events(broker, "listening")
    assert listening["account"] == "me.env"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    script = '. ./me.env && echo "$SWARMWRIGHT_BROKER" "$SWARMWRIGHT_USERNAME" "$SWARMWRIGHT_PASSWORD"'
    said = subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert said.stdout.split() == [listening["url"], *_engine.account(listening["url"])]
    broker.send_signal(signal.SIGINT)
    assert broker.wait(10) == 0
    assert not file.exists()
    file.write_text("notes\n")
    refused = program("broker", "--port", "0", "--account", "me.env")
    assert refused.returncode == 2
    assert "me.env was not written by --account" in refused.stderr
    assert file.read_text() == "notes\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--anonymous", "--users", "users"], "--anonymous and --users exclude each other"),
        (["--account", "x", "--anonymous"], "--account and --anonymous exclude each other"),
        (["--account", "x", "--socket", "s"], "--account needs --port; add it"),
    ],
)
def test_options_that_exclude_each_other(
    program: Any, tmp_path: Path, options: list[str], message: str
) -> None:
    (tmp_path / "users").touch()
    refused = program("broker", *options)
    assert refused.returncode == 2
    assert message in refused.stderr


@pytest.mark.slow
def test_a_broker_admits_all_users_only_where_it_is_asked_to(start: Any) -> None:
    broker = start("broker", "--port", "0", "--anonymous")
    first, second = broker.stdout.readline(), broker.stdout.readline()
    assert second == "Every user of this machine may connect, and read and change runs (--anonymous)\n"
    told = stranger(port_of(first.split()[4]), Path("/nowhere"))
    assert told["codes"] == [0, 0, 0, 0]
