"""Brokers that are reached through others: a web proxy with TLS, a bridge between brokers of two makes."""

import shutil
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from swarmwright import _engine
from tests.conftest import free_port
from tests.system.brokers import BrokerProcess, Kind, reachable
from tests.system.conftest import Experiment, Launch
from tests.system.runs import record
from tests.system.test_cluster import generations

pytestmark = pytest.mark.timeout(200)

EXPERIMENT = (
    "simulation: minisim\nmethod: {kind: nnga, population: 16, generations: 200}\nmode: batched\nseed: 5\n"
)
PROXY = """\
daemon off;
pid nginx.pid;
error_log error.log;
events {{}}
http {{
  access_log off;
  client_body_temp_path body; proxy_temp_path proxy; fastcgi_temp_path f; uwsgi_temp_path u; scgi_temp_path s;
  server {{
    listen 127.0.0.1:{port} ssl;
    ssl_certificate broker.pem;
    ssl_certificate_key broker-key.pem;
    location = /lab/mqtt {{
      proxy_pass http://127.0.0.1:{broker}/mqtt;
      proxy_http_version 1.1;
      proxy_set_header Upgrade $http_upgrade;
      proxy_set_header Connection upgrade;
      proxy_read_timeout 1h;
    }}
  }}
}}
"""


class Nginx:
    """A web server that passes on MQTT over WebSocket, and does nothing else."""

    def __init__(self, folder: Path, broker: int) -> None:
        program = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
        assert program, "nginx is missing; `make test-peers` installs it"
        self._command = [program, "-p", str(folder), "-c", str(folder / "nginx.conf")]
        self._process: subprocess.Popen[bytes] | None = None
        folder.mkdir()
        self.port = free_port()
        authority, _, certificate, key = _engine.certificates(["localhost", "127.0.0.1"], 2)
        for name, text in (("ca.pem", authority), ("broker.pem", certificate), ("broker-key.pem", key)):
            (folder / name).write_text(text)
        (folder / "nginx.conf").write_text(PROXY.format(port=self.port, broker=broker))
        self.url = f"wss://localhost:{self.port}/lab/mqtt"
        self.environment = {"SWARMWRIGHT_CA_FILE": str(folder / "ca.pem")}

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stderr=subprocess.DEVNULL)
        while not reachable(self.port):  # the test's own time-out ends this
            assert self._process.poll() is None
            time.sleep(0.05)

    def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()  # at once: connections are cut
            self._process.wait()
            self._process = None


@pytest.fixture
def websocket(kind: Kind, tmp_path: Path, launch: Launch, cleanup: ExitStack) -> int:
    """The port of a broker of each kind that accepts MQTT over WebSocket."""
    port = free_port()
    if kind == "embedded":
        launch("broker", "--port", 0, "--websocket-port", port, "--anonymous", "--json").until_event(
            "listening"
        )
        return port
    broker = BrokerProcess("mosquitto", tmp_path / "broker")
    with (tmp_path / "broker" / "mosquitto.conf").open("a") as configuration:
        configuration.write(f"listener {port} 127.0.0.1\nprotocol websockets\n")
    cleanup.callback(broker.stop)
    broker.start()
    return port


def test_a_web_proxy_that_is_restarted(
    websocket: int, launch: Launch, experiment: Experiment, tmp_path: Path, cleanup: ExitStack
) -> None:
    proxy = Nginx(tmp_path / "nginx", websocket)
    cleanup.callback(proxy.stop)
    proxy.start()
    path = experiment(EXPERIMENT)
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    serve = launch("serve", "minisim", "--broker", proxy.url, "--json", env=proxy.environment)
    serve.until_event("ready")
    run = launch("optimize", path, "--broker", proxy.url, "--out", "there", "--json", env=proxy.environment)
    run.until(lambda program: generations(program) >= 2, "two generations")
    proxy.stop()
    proxy.start()
    before = generations(run)
    run.until(lambda program: generations(program) > before + 2, "further generations", 100)
    assert run.wait(100) == 0, run.stderr
    assert local.wait(100) == 0, local.stderr
    assert record(tmp_path / "there") == record(tmp_path / "local")


def test_what_is_wrong_with_a_proxy_is_named(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, tmp_path: Path, cleanup: ExitStack
) -> None:
    proxy = Nginx(tmp_path / "nginx", embedded.port)
    cleanup.callback(proxy.stop)
    proxy.start()
    run = launch("optimize", experiment(EXPERIMENT), "--broker", proxy.url)
    assert run.wait(60) == 1
    assert "SWARMWRIGHT_CA_FILE" in run.stderr
    run = launch(
        "optimize", experiment(EXPERIMENT), "--broker", f"{proxy.url}/elsewhere/", env=proxy.environment
    )
    assert run.wait(60) == 1
    assert "HTTP error" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_built_in_broker_behind_a_bridge(
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    tmp_path: Path,
    cleanup: ExitStack,
    mode: str,
) -> None:
    site = BrokerProcess("mosquitto", tmp_path / "site")
    with (tmp_path / "site" / "mosquitto.conf").open("a") as configuration:
        configuration.write(
            f"connection lab\naddress 127.0.0.1:{embedded.port}\ntopic # both 2\n"
            "bridge_protocol_version mqttv50\nrestart_timeout 1\nnotifications false\n"
        )
    cleanup.callback(site.stop)
    site.start()
    path = experiment(EXPERIMENT.replace("batched", mode).replace("200", "8"))
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    launch("serve", "minisim", "--broker", site.url, "--json").until_event("ready")
    run = launch("optimize", path, "--broker", embedded.url, "--out", "there", "--json")
    assert run.wait(100) == 0, run.stderr
    assert local.wait(100) == 0, local.stderr
    assert record(tmp_path / "there") == record(tmp_path / "local")
