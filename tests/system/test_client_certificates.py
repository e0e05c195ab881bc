"""Brokers that require a certificate of each client: real Mosquitto, and the embedded broker likewise."""

import itertools
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import environment
from tests.java import jar
from tests.system.brokers import KINDS, BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.ready_made import DAY, ReadyMade
from tests.system.runs import record

Make = Callable[[str], ReadyMade]
CERTIFICATE, KEY = "SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE"


@pytest.fixture
def make(tmp_path: Path, cleanup: ExitStack) -> Make:
    count = itertools.count()

    def start(kind: str) -> ReadyMade:
        broker = ReadyMade(tmp_path / f"mutual {next(count)}", kind, mutual=True)
        cleanup.callback(broker.stop)
        return broker.start()

    return start


def variables(broker: ReadyMade, user: str) -> dict[str, str]:
    return {**broker.variables(user), **broker.client(user)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_run_with_servers_in_python_and_java(
    make: Make,
    kind: str,
    embedded: BrokerProcess,
    serve: Any,
    serve_java: Any,
    launch: Launch,
    experiment: Experiment,
) -> None:
    broker = make(kind)
    secrets = variables(broker, "server")
    launch("serve", "minisim", "--id", 1, "--json", env=secrets).until_event("ready", 1)
    serve_java(broker.url(), server=2, env=secrets)
    path = experiment()
    tool = launch("optimize", path, "--out", "mutual", env=variables(broker, "tool"))
    assert tool.wait() == 0, tool.stderr
    serve(embedded.url, count=2)
    assert launch("optimize", path, "--broker", embedded.url, "--out", "plain").wait() == 0
    assert record(path.parent / "mutual") == record(path.parent / "plain")


@pytest.mark.parametrize("kind", KINDS)
def test_a_launcher_passes_the_certificate_on(
    make: Make, kind: str, launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    """Servers have one of their own, which `credentials` names with their account."""
    broker = make(kind)
    lines = [f"export {name}={value!r}" for name, value in variables(broker, "server").items()]
    (tmp_path / "server.env").write_text("\n".join(lines))
    path = experiment()
    options = ("--set", "servers={launcher: process, count: 2, credentials: server.env}")
    tool = launch("optimize", path, *options, "--out", "launched", env=variables(broker, "tool"))
    assert tool.wait() == 0, tool.stderr


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [False, True])
def test_what_is_wrong_with_the_certificate_is_told(
    make: Make, launch: Launch, kind: str, late: bool
) -> None:
    """late: it has expired; otherwise there is none."""
    broker = make(kind)
    own = broker.client("watcher", begins=-3 * DAY, ends=-DAY) if late else {}
    refused = launch("servers", env={**broker.variables("watcher"), **own})
    assert refused.wait() == 1
    words = ["refuses the client certificate", own[CERTIFICATE]] if late else ["requires a client", KEY]
    for word in (broker.url(), CERTIFICATE, *words):
        assert word in refused.stderr, refused.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_a_certificate_of_another_authority_is_refused(
    make: Make, launch: Launch, kind: str, tmp_path: Path
) -> None:
    broker, other = make(kind), ReadyMade(tmp_path / "other")
    refused = launch("servers", env={**broker.variables("watcher"), **other.client("watcher")})
    assert refused.wait() == 1
    for word in (broker.url(), "refuses the client certificate", str(other.folder)):
        assert word in refused.stderr, refused.stderr


def _encrypted(_: ReadyMade, own: dict[str, str]) -> dict[str, str]:
    hidden = f"{own[KEY]}.hidden"
    command = ["openssl", "pkcs8", "-topk8", "-in", own[KEY], "-out", hidden, "-passout", "pass:word"]
    subprocess.run(command, check=True, capture_output=True)
    return {**own, KEY: hidden}


WRONG: dict[str, tuple[Callable[[ReadyMade, dict[str, str]], dict[str, str]], tuple[str, ...]]] = {
    "no key": (lambda _, own: {CERTIFICATE: own[CERTIFICATE]}, (f"{KEY} is not", "needs both")),
    "no certificate": (lambda _, own: {KEY: own[KEY]}, (f"{CERTIFICATE} is not", "needs both")),
    "no file": (lambda _, own: {**own, CERTIFICATE: "none.pem"}, ("none.pem", "No such file")),
    "a key as certificate": (lambda _, own: {**own, CERTIFICATE: own[KEY]}, ("it contains no certificate",)),
    "a passphrase": (_encrypted, ("without a passphrase", "openssl pkey")),
    "another key": (lambda broker, own: {**own, KEY: broker.client("x")[KEY]}, ("is not the key of",)),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_files_that_cannot_be_used_are_named(make: Make, launch: Launch, wrong: str) -> None:
    broker = make("embedded")
    change, words = WRONG[wrong]
    refused = launch(
        "servers", env={**broker.variables("watcher"), **change(broker, broker.client("watcher"))}
    )
    # What the environment says is input; what files hold is found out when they are used.
    assert refused.wait() == (2 if wrong in {"no key", "no certificate"} else 1)
    for word in words:
        assert word in refused.stderr, refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_certificate_of_version_1_is_the_brokers_business(make: Make, launch: Launch) -> None:
    """As `openssl x509 -req` makes it without extensions: Mosquitto accepts it, the embedded broker not."""
    for kind, status in (("mosquitto", 0), ("embedded", 1)):
        broker = make(kind)
        folder = broker.folder
        own = {CERTIFICATE: str(folder / "old.pem"), KEY: str(folder / "old-key.pem")}
        algorithm = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-noenc")
        request = ("req", "-new", *algorithm, "-subj", "/CN=old", "-keyout", own[KEY], "-out", "old.csr")
        authority = ("-CA", "ca.pem", "-CAkey", "ca-key.pem", "-CAcreateserial")
        sign = ("x509", "-req", "-in", "old.csr", *authority, "-days", "2", "-out", own[CERTIFICATE])
        for words in (request, sign):
            subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)
        known = launch("servers", env={**broker.variables("watcher"), **own})
        assert known.wait() == status, known.stderr
    assert "refuses the client certificate" in known.stderr


def test_servers_in_java_say_what_to_do(make: Make) -> None:
    broker = make("embedded")
    command = ["java", "-jar", str(jar()), "--broker", broker.url(), "--id", "2"]
    given = environment(broker.variables("server"))
    refused = subprocess.run(command, env=given, capture_output=True, text=True, timeout=60, check=False)
    assert refused.returncode != 0
    for word in (broker.url().removeprefix("mqtts"), "certificate_required", CERTIFICATE, KEY):
        assert word in refused.stderr
    assert "is it running" not in refused.stderr


def test_authorities_of_clients_need_tls(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("")
    refused = launch("broker", "--port", 0, "--client-ca", "ca.pem")
    assert refused.wait() == 2
    for word in ("--client-ca", "--certificate"):
        assert word in refused.stderr
