"""Brokers that the package registries have: how each is installed, and started on a port of loopback."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.brokers import java, rabbitmq
from tests.brokers.installing import (
    go_release,
    install_jars,
    jar_release,
    npm_release,
    pip_release,
    run,
)
from tests.conftest import free_port

AEDES = """\
import { Aedes } from 'aedes';
import net from 'node:net';
const broker = await Aedes.createBroker();
net.createServer(broker.handle).listen(Number(process.argv[2]), '127.0.0.1');
"""


@dataclass(frozen=True)
class Entry:
    """A broker with its settings as it comes.

    install: makes what `command` needs in a folder, and does nothing where it is there; a RuntimeError or
    OSError says why it cannot. release: which one is installed in the folder. command: writes a
    configuration into a folder and returns what to start, given the folder of the installation, the folder
    and a port.
    """

    name: str
    install: Callable[[Path], None]
    release: Callable[[Path], str]
    command: Callable[[Path, Path, int], list[str]]


def mosquitto_program() -> str:
    """The program, which is in no user's path on Debian."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin") or "mosquitto"


def _mosquitto_release(_home: Path) -> str:
    # its help ends with a status of 1 or 3, by its release
    said = subprocess.run(
        [mosquitto_program(), "-h"], capture_output=True, text=True, timeout=10, check=False
    ).stdout
    return said.partition("version ")[2].split()[0]


def _ask_mosquitto(home: Path) -> None:
    _mosquitto_release(home)


def _mosquitto(_home: Path, folder: Path, port: int) -> list[str]:
    lines = [f"listener {port} 127.0.0.1", "allow_anonymous true"]
    if os.getuid() == 0:
        lines.append("user root")
    (folder / "mosquitto.conf").write_text("\n".join(lines) + "\n")
    return [mosquitto_program(), "-c", str(folder / "mosquitto.conf")]


def _install_aedes(home: Path) -> None:
    if not (home / "node_modules" / "aedes").exists():
        run("npm", "install", "--silent", "--prefix", str(home), "aedes@1.2.0")
    (home / "broker.mjs").write_text(AEDES)


def _aedes(home: Path, _folder: Path, port: int) -> list[str]:
    return ["node", str(home / "broker.mjs"), str(port)]


def _install_amqtt(home: Path) -> None:
    if not (home / "bin" / "amqtt").exists():
        run(sys.executable, "-m", "venv", str(home))
        run(str(home / "bin" / "python"), "-m", "pip", "install", "--quiet", "amqtt==0.12.1")


def _amqtt(home: Path, folder: Path, port: int) -> list[str]:
    (folder / "amqtt.yaml").write_text(
        f"listeners:\n  default:\n    type: tcp\n    bind: 127.0.0.1:{port}\n"
        "plugins:\n  amqtt.plugins.authentication.AnonymousAuthPlugin:\n    allow_anonymous: true\n"
    )
    return [str(home / "bin" / "amqtt"), "-c", str(folder / "amqtt.yaml")]


def _go_version() -> tuple[int, ...]:
    found = re.search(r"go(\d+)\.(\d+)", run("go", "env", "GOVERSION"))
    return tuple(int(number) for number in found.groups()) if found else (0, 0)


def _install_go(binary: str, package: str, older: str = "") -> Callable[[Path], None]:
    """older: the release for a Go before 1.21, which fetches no newer Go by itself, if there is one."""

    def install(home: Path) -> None:
        if (home / binary).exists():
            return
        path, _, newest = package.partition("@")
        has = _go_version()
        if has < (1, 21) and not older:
            raise RuntimeError(f"{package} needs a newer Go than {has[0]}.{has[1]}, which is here")
        run("go", "install", f"{path}@{newest if has >= (1, 21) else older}", env={"GOBIN": str(home)})

    return install


def _mochi(home: Path, _folder: Path, port: int) -> list[str]:
    others = [f"127.0.0.1:{free_port()}" for _ in range(2)]
    return [str(home / "cmd"), "-tcp", f"127.0.0.1:{port}", "-ws", others[0], "-info", others[1]]


def _nats(home: Path, folder: Path, port: int) -> list[str]:
    (folder / "nats.conf").write_text(
        f"server_name: one\nhost: 127.0.0.1\nport: {free_port()}\n"
        f"jetstream {{ store_dir: {folder}/store }}\nmqtt {{ host: 127.0.0.1, port: {port} }}\n"
    )
    return [str(home / "nats-server"), "-c", str(folder / "nats.conf")]


def _install_rumqttd(home: Path) -> None:
    if not (home / "bin" / "rumqttd").exists():
        run("cargo", "install", "--quiet", "--root", str(home), "--version", "0.20.0", "rumqttd")


def _rumqttd_release(home: Path) -> str:
    return run(str(home / "bin" / "rumqttd"), "--version").split()[-1]


def _rumqttd(home: Path, folder: Path, port: int) -> list[str]:
    connections = (
        "connection_timeout_ms = 60000\nmax_payload_size = 20480\nmax_inflight_count = 100\n"
        "dynamic_filters = true\n"
    )
    (folder / "rumqttd.toml").write_text(
        "id = 0\n[router]\nid = 0\nmax_connections = 10010\nmax_outgoing_packet_count = 200\n"
        "max_segment_size = 104857600\nmax_segment_count = 10\n"
        f'[v5.1]\nname = "v5"\nlisten = "127.0.0.1:{port}"\nnext_connection_delay_ms = 1\n'
        f"[v5.1.connections]\n{connections}"
    )
    return [str(home / "bin" / "rumqttd"), "-q", "-c", str(folder / "rumqttd.toml")]


MOCHI = "github.com/mochi-mqtt/server/v2/cmd@v2.7.9"
NATS = "github.com/nats-io/nats-server/v2@v2.15.2"
MOQUETTE = install_jars("io.moquette", "0.17", "moquette-broker")
HIVEMQ = install_jars("com.hivemq", "2025.5", "hivemq-community-edition-embedded")
ARTEMIS = install_jars("org.apache.activemq", "2.40.0", "artemis-server", "artemis-mqtt-protocol")

BROKERS: tuple[Entry, ...] = (
    Entry("mosquitto", _ask_mosquitto, _mosquitto_release, _mosquitto),
    Entry("aedes", _install_aedes, npm_release("aedes"), _aedes),
    Entry("amqtt", _install_amqtt, pip_release("amqtt"), _amqtt),
    Entry("mochi", _install_go("cmd", MOCHI, older="v2.3.0"), go_release("cmd"), _mochi),
    Entry("nats", _install_go("nats-server", NATS), go_release("nats-server"), _nats),
    Entry("rumqttd", _install_rumqttd, _rumqttd_release, _rumqttd),
    Entry("moquette", MOQUETTE, jar_release("moquette-broker"), java.moquette),
    Entry("hivemq", HIVEMQ, jar_release("hivemq-community-edition-embedded"), java.hivemq),
    Entry("artemis", ARTEMIS, jar_release("artemis-server"), java.artemis),
    Entry("rabbitmq", rabbitmq.install, rabbitmq.release, rabbitmq.command),
)
