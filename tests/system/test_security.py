"""Who may do what with the ready-made configuration: real Mosquitto, and the embedded broker likewise."""

import contextlib
import datetime as dt
import itertools
import json
import os
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.system.brokers import KINDS, BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.peer import TOPICS, Peer, Received
from tests.system.ready_made import DAY, ReadyMade
from tests.system.recorder import Recorder
from tests.system.runs import record

Make = Callable[..., ReadyMade]

STATUS = "swarmwright/v1/status/5f00"
EXTENSIONS = ("swarmwright/v1/presence/3", "swarmwright/v1/server/3", "swarmwright/v1/tool/5f00", STATUS)
OF_TOOLS = {"discovery", "parameters", "control", "actuator", "swarmwright/v1/server/3"}
OF_SERVERS = {"server", "sensor", "fitness", "swarmwright/v1/presence/3", "swarmwright/v1/tool/5f00"}
WRITES = {"tool": {*OF_TOOLS, STATUS}, "server": OF_SERVERS, "watcher": set[str]()}
READS = {
    "tool": OF_SERVERS,
    "server": {*OF_TOOLS, "swarmwright/v1/presence/3"},
    "watcher": {*OF_TOOLS, *OF_SERVERS, STATUS},
}


@pytest.fixture
def make(tmp_path: Path, cleanup: ExitStack) -> Make:
    """Makes a configuration and starts a broker with it: `make(kind="mosquitto", prefixes=())`."""
    count = itertools.count()

    def start(kind: str = "mosquitto", prefixes: tuple[str, ...] = ()) -> ReadyMade:
        broker = ReadyMade(tmp_path / f"secured {next(count)}", kind, prefixes)
        cleanup.callback(broker.stop)
        return broker.start()

    return start


def join(broker: ReadyMade, user: str, *filters: str, kind: type[Peer] = Recorder, again: bool = True) -> Any:
    login = (user, broker.password(user))
    return kind(broker.url(), *filters, again=again, login=login, authority=broker.authority)


def said(messages: list[Received]) -> set[tuple[str, str]]:
    """Topic and content of what came, the end mark left out."""
    found = {(message.topic, message.payload.decode()) for message in messages}
    return {(topic, content) for topic, content in found if content != "end"}


# Mosquitto takes 0.1 s for each log-in, and more on a busy machine.
@pytest.mark.timeout(240)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("prefixes", [(), ("lab/a", "lab/b")], ids=["alone", "realms"])
def test_every_account_reads_and_writes_what_its_role_may_and_nothing_else(
    make: Make, cleanup: ExitStack, kind: str, prefixes: tuple[str, ...]
) -> None:
    """Judged by what arrives: brokers acknowledge what they do not pass on."""
    broker = make(kind, prefixes)
    realms = {f"{prefix.replace('/', '-')}-" if prefix else "": prefix for prefix in prefixes or ("",)}
    users = {f"{stem}{role}": (role, prefix) for stem, prefix in realms.items() for role in WRITES}
    peers = {user: cleanup.enter_context(join(broker, user, "#", "$SYS/#")) for user in users}

    def under(prefix: str, topics: set[str]) -> set[str]:
        return {f"{prefix}/{topic}" if prefix else topic for topic in topics}

    others = {"", *prefixes} if prefixes else {"", "x"}
    topics = set.union(*(under(prefix, {*TOPICS, *EXTENSIONS, "other"}) for prefix in others))
    for user, topic in itertools.product(users, sorted(topics)):
        # Mosquitto 2.0.11 ends the connection of one that is denied, after its acknowledgement.
        with join(broker, user, kind=Peer, again=False) as writer, contextlib.suppress(RuntimeError):
            writer.publish(topic, user, qos=1)
    for user, (role, prefix) in users.items():
        for topic in under(prefix, {"tool": {"discovery"}, "server": {"server"}}.get(role, set())):
            peers[user].publish(topic, "end", qos=1)

    written = {
        (topic, user) for user, (role, prefix) in users.items() for topic in under(prefix, WRITES[role])
    }
    for user, (role, prefix) in users.items():
        may = under(prefix, READS[role])
        expected = {(topic, writer) for topic, writer in written if topic in may}
        peers[user].settle()
        assert said(peers[user].messages) == expected, user
        assert any(message.payload == b"end" for message in peers[user].messages), user


@pytest.mark.journey
@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_run_over_tls_with_two_servers(
    make: Make,
    kind: str,
    embedded: BrokerProcess,
    serve: Any,
    launch: Launch,
    experiment: Experiment,
) -> None:
    broker = make(kind)
    server = launch(
        "serve",
        "minisim",
        "--id",
        1,
        "--count",
        2,
        "--json",
        *logged("server.log"),
        env=broker.variables("server"),
    )
    server.until_event("ready", 2)
    path = experiment()
    # Whatever is logged, passwords are not.
    watching = launch("servers", "--watch", "--json", env=broker.variables("watcher"))
    tool = launch("optimize", path, "--out", "secured", *logged("tool.log"), env=broker.variables("tool"))
    watcher = launch("servers", "--json", env=broker.variables("watcher"))
    processes = _process_list()
    assert tool.wait() == 0, tool.stderr
    assert watcher.wait() == 0, watcher.stderr
    assert '"server": 1' in "".join(watcher.lines)
    assert '"server": 2' in "".join(watcher.lines)

    serve(embedded.url, count=2)
    assert launch("optimize", path, "--broker", embedded.url, "--out", "plain").wait() == 0
    assert record(path.parent / "secured") == record(path.parent / "plain")

    server.stop()
    broker.stop()
    watching.stop()
    outputs = [
        *watching.lines,
        watching.stderr,
        *server.lines,
        server.stderr,
        *tool.lines,
        tool.stderr,
        *watcher.lines,
        watcher.stderr,
    ]
    everything = "\n".join([*outputs, broker.log.read_text()]).encode() + processes
    assert str(broker.folder).encode() in processes, "the broker is in the list"
    logs = [path.parent / "server.log", path.parent / "tool.log"]
    assert all(b'"event"' in log.read_bytes() for log in logs)
    for file in [*logs, *sorted((path.parent / "secured").rglob("*"))]:
        everything += file.read_bytes() if file.is_file() else b""
    for user in ("tool", "server", "watcher"):
        assert broker.password(user).encode() not in everything, user


def logged(name: str) -> tuple[str, ...]:
    """Options that have everything logged."""
    return ("--log", name, "--log-level", "debug")


def _process_list() -> bytes:
    """How all processes of this machine were called, as `ps` shows everybody."""
    lines = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            lines.append(file.read_bytes())
    return b"\n".join(lines)


@pytest.mark.parametrize("kind", KINDS)
def test_strangers_are_refused(make: Make, launch: Launch, kind: str) -> None:
    broker = make(kind)
    known = broker.variables("watcher")
    assert launch("servers", env=known).wait() == 0
    anonymous = {name: known[name] for name in ("SWARMWRIGHT_BROKER", "SWARMWRIGHT_CA_FILE")}
    wrong = {**anonymous, "SWARMWRIGHT_USERNAME": "watcher", "SWARMWRIGHT_PASSWORD": "let-me-in-4711"}
    unknown = {**wrong, "SWARMWRIGHT_USERNAME": "admin"}
    for variables, who in ((anonymous, "without a user name"), (wrong, "watcher"), (unknown, "admin")):
        refused = launch("servers", env=variables)
        assert refused.wait() == 1
        for word in (broker.url(), who, "SWARMWRIGHT_PASSWORD_FILE"):
            assert word in refused.stderr
        assert "4711" not in refused.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_an_account_without_the_rights_is_told_what_it_may_not_publish(
    make: Make, launch: Launch, experiment: Experiment, kind: str
) -> None:
    broker = make(kind)
    tool = launch("optimize", experiment(), "--out", "denied", env=broker.variables("watcher"))
    assert tool.wait() == 1
    denied = 'does not let user "watcher" publish on "discovery"'
    rules = (
        "correct the broker's access rules, or set the topic prefix that this account belongs to (--prefix,"
    )
    for word in (broker.url(), denied, rules):
        assert word in tool.stderr
    server = launch("serve", "minisim", "--id", 1, env=broker.variables("tool"))
    words = 'does not let user "tool" publish on "swarmwright/v1/presence/1"'
    server.until(lambda program: words in "".join(program.lines) + program.stderr, "the refusal", 20)
    assert rules in "".join(server.lines) + server.stderr


def test_servers_without_the_prefix_of_their_account_end(make: Make, launch: Launch) -> None:
    """Mosquitto closes the connection of a client that publishes what it may not."""
    broker = make("mosquitto", ("lab/a",))
    variables = {**broker.variables("lab-a-server"), "SWARMWRIGHT_PREFIX": ""}
    servers = launch("serve", "minisim", "--count", 2, env=variables)
    assert servers.wait() == 1
    assert (
        "the topic prefix that this account belongs to (--prefix," in "".join(servers.lines) + servers.stderr
    )


@pytest.mark.parametrize("kind", KINDS)
def test_lost_servers_are_forgotten_by_the_account_of_a_server_alone(
    make: Make, launch: Launch, kind: str
) -> None:
    broker = make(kind)
    server = launch("serve", "minisim", "--id", 1, "--json", env=broker.variables("server"))
    ready = server.until_event("ready")
    for pid in (server.pid, ready["pid"]):
        os.kill(pid, signal.SIGKILL)
    server.process.wait(10)

    def states() -> list[str]:
        listing = launch("servers", "--json", env=broker.variables("watcher"))
        assert listing.wait() == 0
        return [json.loads(line)["state"] for line in listing.lines]

    deadline = time.monotonic() + 10
    while states() != ["lost"]:
        assert time.monotonic() < deadline
    for account, status, left in (("tool", 1, ["lost"]), ("server", 0, [])):
        forgetting = launch("servers", "--forget-lost", env=broker.variables(account))
        assert forgetting.wait() == status, forgetting.stderr
        assert states() == left


def _later(days: float) -> dt.timedelta:
    return dt.timedelta(days=days)


WRONG: dict[str, tuple[tuple[str, ...], dt.timedelta, dt.timedelta, tuple[str, ...]]] = {
    "name": (
        ("broker.example", "x.example"),
        -DAY,
        DAY,
        ("broker.example, x.example", 'not for "localhost"'),
    ),
    "expired": (("localhost",), _later(-30), _later(-3.5), ("has expired, 3 days ago", "clock")),
    "early": (("localhost",), _later(2.5), _later(9), ("becomes valid only in 2 days", "clock")),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_certificate_is_refused(make: Make, launch: Launch, wrong: str) -> None:
    """The message says which and why; before anything was sent, the password above all."""
    broker = make()
    broker.stop()
    hosts, begins, ends, words = WRONG[wrong]
    broker.certify(*hosts, begins=begins, ends=ends)
    broker.start()
    refused = launch("servers", env=broker.variables("watcher"))
    assert refused.wait() == 1
    for word in (broker.url(), "the broker's certificate", *words):
        assert word in refused.stderr
    assert "as watcher" not in broker.log.read_text()
    assert "u'watcher'" not in broker.log.read_text()


def test_a_certificate_of_another_authority_is_refused(make: Make, launch: Launch) -> None:
    broker, other = make(), make()
    mixed = {**broker.variables("watcher"), "SWARMWRIGHT_CA_FILE": str(other.authority)}
    refused = launch("servers", env=mixed)
    assert refused.wait() == 1
    for word in (broker.url(), "an authority that is not in", str(other.authority), "SWARMWRIGHT_CA_FILE"):
        assert word in refused.stderr
    del mixed["SWARMWRIGHT_CA_FILE"]
    refused = launch("servers", env=mixed)
    assert refused.wait() == 1
    for word in (broker.url(), "unknown to this system", "SWARMWRIGHT_CA_FILE"):
        assert word in refused.stderr


def test_an_authority_file_that_is_none(make: Make, launch: Launch, tmp_path: Path) -> None:
    broker = make()
    (tmp_path / "empty.pem").write_text("nothing\n")
    for name, why in (("empty.pem", "no certificate"), ("none.pem", "No such file")):
        variables = {**broker.variables("watcher"), "SWARMWRIGHT_CA_FILE": str(tmp_path / name)}
        refused = launch("servers", env=variables)
        assert refused.wait() == 1
        for word in (name, why, "SWARMWRIGHT_CA_FILE"):
            assert word in refused.stderr


def test_tls_where_there_is_none(embedded: BrokerProcess, launch: Launch) -> None:
    refused = launch("servers", "--broker", embedded.url.replace("mqtt:", "mqtts:"))
    assert refused.wait() == 1
    assert f"127.0.0.1:{embedded.port}" in refused.stderr


def test_a_hundred_megabytes_reach_nobody(
    broker: BrokerProcess, serve: Any, launch: Launch, experiment: Experiment
) -> None:
    """The built-in broker ends the sender's connection; Mosquitto takes it and is told not to pass it on."""
    servers = serve(broker.url)
    status = Path(f"/proc/{servers.pids[1]}/status")

    def most() -> int:
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024

    before = most()
    for topic in ("control", "swarmwright/v1/server/1"):
        with Peer(broker.url, again=False) as sender, contextlib.suppress(RuntimeError):
            sender.publish(topic, b"[" * 100_000_000)
    assert launch("optimize", experiment(), "--broker", broker.url, "--out", "result").wait() == 0
    assert most() - before < 64_000_000
