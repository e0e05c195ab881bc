"""Processes that a benchmark starts: brokers and simulation servers."""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROGRAM = (sys.executable, "-P", "-m", "swarmwright")
PATIENCE = 20.0


def output(*command: str, cwd: Path) -> str:
    """Run a command to its end, as users have it; return its standard output."""
    result = subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=300, cwd=cwd, env=_environment()
    )
    if result.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: {result.stderr}")
    return result.stdout


def seconds_until(word: str, *command: str, cwd: Path) -> tuple[float, str]:
    """Run a command to its end; return the seconds until it had printed a line with a word, and the line."""
    start = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=cwd, env=_environment()) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if word in line:
                seconds = time.perf_counter() - start
                process.communicate(timeout=300)
                return seconds, line
    raise SystemExit(f"{' '.join(command)}: ended with {process.returncode} before it printed {word}")


def _environment() -> dict[str, str]:
    # Modules are compiled once, not at every start.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return environment | {"PYTHONPATH": ""}


@dataclass(frozen=True)
class Broker:
    """A broker that runs in a process of its own."""

    name: str
    port: int
    pid: int

    @property
    def url(self) -> str:
        """Its address."""
        return f"mqtt://127.0.0.1:{self.port}"


@contextlib.contextmanager
def embedded(*options: str) -> Iterator[Broker]:
    """The embedded broker, by `swarmwright broker`. options: further ones of the command line.

    Any user of the machine is admitted, since what is measured has clients of all kinds.
    """
    account = [] if "--users" in options else ["--anonymous"]
    with _running([*PROGRAM, "broker", "--port", "0", "--json", *account, *options]) as process:
        news = _line(process, "listening")
        yield Broker("embedded", int(news["port"]), process.pid)


@contextlib.contextmanager
def mosquitto() -> Iterator[Broker]:
    """Mosquitto, with the one option that it needs to be fast."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if program is None:
        raise SystemExit("mosquitto is missing; `apt-get install mosquitto` brings it")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    lines = [f"listener {port} 127.0.0.1", "allow_anonymous true", "set_tcp_nodelay true", "log_type error"]
    if os.getuid() == 0:
        lines.append("user root")
    with tempfile.TemporaryDirectory() as folder:
        configuration = Path(folder, "mosquitto.conf")
        configuration.write_text("\n".join(lines) + "\n", encoding="utf-8")
        with _running([program, "-c", str(configuration)]) as process:
            deadline = time.monotonic() + PATIENCE
            while True:
                with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                    break
                if process.poll() is not None or time.monotonic() > deadline:
                    raise SystemExit(f"mosquitto does not listen on port {port}")
                time.sleep(0.02)
            yield Broker("Mosquitto", port, process.pid)


@contextlib.contextmanager
def servers(broker: Broker, count: int, prefix: str, simulation: str = "minisim") -> Iterator[list[int]]:
    """Simulation servers, each a process; their process ids, once all are ready."""
    command = [
        *PROGRAM,
        "serve",
        simulation,
        "--broker",
        broker.url,
        "--count",
        str(count),
        "--id",
        "1" if simulation == "minisim" else "101",
        "--json",
    ]
    if prefix:
        command += ["--prefix", prefix]
    with _running(command) as process:
        found: dict[int, int] = {}
        while len(found) < count:
            news = _line(process, "ready")
            found[int(news["server"])] = int(news["pid"])
        yield list(found.values())


def peak_memory(pid: int) -> float:
    """Most memory that a running process has had resident, in MB (10^6 bytes)."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise SystemExit(f"/proc/{pid}/status does not say how much memory the process has had")


def processor_seconds(pid: int) -> float:
    """Processor time that a running process has used, with all its threads, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def _running(command: Sequence[str]) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=ROOT,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _line(process: "subprocess.Popen[str]", event: str) -> dict[str, str]:
    """The next line of news of the kind `event`."""
    assert process.stdout is not None
    for line in process.stdout:
        news: dict[str, str] = json.loads(line)
        if news.get("event") == event:
            return news
    raise SystemExit(f"a process ended before it was {event}: {process.args!r}")
