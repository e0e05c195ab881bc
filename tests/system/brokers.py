"""Brokers as processes that a test can configure, kill and start again on the same port."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from tests.conftest import PROGRAM, environment, free_port

Kind = Literal["embedded", "mosquitto"]
KINDS: tuple[Kind, ...] = ("embedded", "mosquitto")


def reachable(port: int) -> bool:
    """Whether somebody listens on the port of loopback."""
    try:
        socket.create_connection(("127.0.0.1", port), 1).close()
    except OSError:
        return False
    return True


class BrokerProcess:
    """A broker on a port of its own; `users` are let in by password, everybody when there are none.

    persistent: it keeps sessions and retained messages in a file (Mosquitto).
    collecting: it leaves Nagle's algorithm on, as Mosquitto does when not told otherwise (Mosquitto).
    """

    def __init__(
        self,
        kind: Kind,
        folder: Path,
        users: Mapping[str, str] | None = None,
        *,
        persistent: bool = False,
        collecting: bool = False,
    ) -> None:
        self.port = free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        folder.mkdir(parents=True, exist_ok=True)
        prepare = _embedded if kind == "embedded" else _mosquitto
        self._command = prepare(self.port, folder, users or {})
        if persistent:
            with (folder / "mosquitto.conf").open("a") as configuration:
                configuration.write(
                    f"persistence true\npersistence_location {folder}/\nautosave_interval 1\n"
                )
        if collecting:
            file = folder / "mosquitto.conf"
            text = file.read_text()
            assert "set_tcp_nodelay true\n" in text
            file.write_text(text.replace("set_tcp_nodelay true\n", ""))
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> "BrokerProcess":
        """Start it and wait until it listens."""
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment(),
        )
        deadline = time.monotonic() + 15
        while not reachable(self.port):
            assert self._process.poll() is None, f"the broker ended: {self._command}"
            assert time.monotonic() < deadline, f"the broker does not listen: {self._command}"
            time.sleep(0.02)
        return self

    def kill(self) -> None:
        """End it without a chance to say anything, as a power cut would."""
        self._signal(signal.SIGKILL)

    def stop(self) -> None:
        """Ask it to end."""
        self._signal(signal.SIGTERM)

    def _signal(self, number: signal.Signals) -> None:
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(number)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(10)
        self._process = None


def _embedded(port: int, folder: Path, users: Mapping[str, str]) -> list[str]:
    command = [*PROGRAM, "broker", "--port", str(port)]
    if users:
        file = folder / "users.txt"
        for name, password in users.items():
            add = [*PROGRAM, "broker", "--add-user", str(file), name]
            subprocess.run(
                add, input=f"{password}\n", text=True, check=True, capture_output=True, env=environment()
            )
        command += ["--users", str(file)]
    else:
        command.append("--anonymous")  # for clients of all kinds, as Mosquitto below
    return command


def _mosquitto(port: int, folder: Path, users: Mapping[str, str]) -> list[str]:
    binary = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    assert binary, "mosquitto is missing; `make test` installs it"
    lines = [f"listener {port} 127.0.0.1", "set_tcp_nodelay true", "max_queued_messages 0"]
    if os.getuid() == 0:
        lines.insert(0, "user root")
    if users:
        file = folder / "passwords"
        for index, (name, password) in enumerate(users.items()):
            create = [] if index else ["-c"]
            tool = ["mosquitto_passwd", "-b", *create, str(file), name, password]
            subprocess.run(tool, check=True, capture_output=True)
        lines += ["allow_anonymous false", f"password_file {file}"]
    else:
        lines.append("allow_anonymous true")
    configuration = folder / "mosquitto.conf"
    configuration.write_text("\n".join(lines) + "\n")
    return [binary, "-c", str(configuration)]
