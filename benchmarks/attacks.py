"""`python -m benchmarks.attacks FILE.json`: what attacks on the built-in broker cost its other clients.

Each attack runs for some seconds, from a process of its own, on a broker of its own. An honest client sends
itself a message every 10 ms meanwhile. It did so before, too, beside a process that keeps a processor busy
but leaves the broker alone, since an attacker does as much.
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import socket
import ssl
import statistics
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.processes import PROGRAM, Broker, embedded, peak_memory

MIB = 1 << 20
BUDGET = 64
"""What the broker may keep for clients, MiB (`--memory`)."""
SECONDS = 4.0
PAUSE = 0.01
PASSWORD = "right"


def text(value: str | bytes) -> bytes:
    """A string as MQTT has them."""
    raw = value.encode() if isinstance(value, str) else value
    return struct.pack(">H", len(raw)) + raw


def packet(kind: int, body: bytes) -> bytes:
    """A packet with its length."""
    length, head = len(body), bytes([kind])
    while True:
        head += bytes([length % 128 | (128 if length > 127 else 0)])
        length //= 128
        if not length:
            return head + body


def hello(identifier: str, *, will: int = 0, password: str = "") -> bytes:
    """CONNECT of MQTT 5; will: bytes of a last will, with a session of an hour."""
    flags = 2 if not will else 4
    flags |= 0xC0 if password else 0
    session = b"\x05\x11" + struct.pack(">I", 3600) if will else b"\x00"
    body = text("MQTT") + bytes([5, flags]) + struct.pack(">H", 60) + session + text(identifier)
    if will:
        body += b"\x05\x18" + struct.pack(">I", 3600) + text("will") + text(bytes(will))
    if password:
        body += text("ada") + text(password)
    return packet(0x10, body)


_contexts: list[ssl.SSLContext] = []
"""The last one is that of the broker; none without TLS."""


def dial(port: int, source: str = "127.0.0.1") -> socket.socket:
    """A connection to the broker, with TLS where this is measured."""
    stream = socket.create_connection(("127.0.0.1", port), 10, (source, 0))
    return _contexts[-1].wrap_socket(stream, server_hostname="localhost") if _contexts else stream


def join(port: int, identifier: str, *, source: str = "127.0.0.1", **options: object) -> socket.socket:
    """A client that is connected; OSError where it is refused."""
    stream = dial(port, source)
    stream.sendall(hello(identifier, **options))  # type: ignore[arg-type]
    answer = stream.recv(4096)
    if len(answer) < 4 or answer[3]:
        stream.close()
        raise ConnectionRefusedError(f"CONNACK {answer!r}")
    return stream


def pour(streams: list[socket.socket], data: bytes, deadline: float) -> None:
    """Send the same again and again to all, as fast as each takes it, and read nothing."""
    for stream in streams:
        stream.setblocking(False)
    offsets = [0] * len(streams)
    while time.monotonic() < deadline:
        stuck = True
        for index, stream in enumerate(streams):
            with contextlib.suppress(OSError):
                sent = stream.send(data[offsets[index] :])
                offsets[index] = (offsets[index] + sent) % len(data)
                stuck = False
        if stuck:
            time.sleep(0.002)


def busy(_port: int, deadline: float) -> None:
    """Leaves the broker alone."""
    while time.monotonic() < deadline:
        pass


def websocket_pings(port: int, deadline: float) -> None:
    """Four strangers without a password."""
    request = (
        "GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: "
        "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n"
    )
    streams = []
    for _ in range(4):
        stream = dial(port + 1)
        stream.sendall(request.encode())
        stream.recv(4096)
        streams.append(stream)
    pour(streams, (b"\x89\xfd\x01\x02\x03\x04" + bytes(125)) * 500, deadline)


def subscribe(port: int, deadline: float) -> None:
    """300,000 filters in one SUBSCRIBE."""
    stream = join(port, "greedy")
    body = b"\x00\x01\x00" + b"".join(text(f"+/+/{number}") + b"\x00" for number in range(300_000))
    stream.sendall(packet(0x82, body))
    time.sleep(max(0, deadline - time.monotonic()))


def retained(port: int, deadline: float) -> None:
    """1,000 filters, again and again, against 100,000 retained messages."""
    writer = join(port, "writer")
    writer.sendall(b"".join(packet(0x31, text(f"kept/{number}/x") + b"\x00x") for number in range(100_000)))
    stream = join(port, "greedy")
    body = b"\x00\x01\x00" + b"".join(text(f"+/+/{number}") + b"\x00" for number in range(1000))
    pour([stream], packet(0x82, body), deadline)


def sessions(port: int, deadline: float) -> None:
    """Sessions of an hour with a last will of 60 kB, and no connection any more."""
    number = 0
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError):
            join(port, f"away-{number}", will=60_000).close()
        number += 1


def acknowledgements(port: int, deadline: float) -> None:
    """Messages of QoS 1 whose PUBACK nobody reads."""
    pour([join(port, "rude")], packet(0x32, text("nobody") + b"\x00\x01\x00") * 5000, deadline)


def ping_responses(port: int, deadline: float) -> None:
    """20 clients that do not read PINGRESP."""
    pour([join(port, f"rude-{number}") for number in range(20)], b"\xc0\x00" * 5000, deadline)


def subscribers(port: int, deadline: float) -> None:
    """40 subscribers that do not read, and who sends them messages of 64 KiB."""
    idle = [join(port, f"idle-{number}") for number in range(40)]
    for stream in idle:
        stream.sendall(packet(0x82, b"\x00\x01\x00" + text("flood") + b"\x00"))
    pour([join(port, "flood")], packet(0x30, text("flood") + b"\x00" + bytes(64 << 10)), deadline)


def partial_packets(port: int, deadline: float) -> None:
    """40 messages of 60 MiB that never end."""
    streams = [join(port, f"part-{number}") for number in range(40)]
    for stream in streams:
        stream.sendall(b"\x30\x80\x80\x80\x1e")
    pour(streams, bytes(MIB), deadline)


def guesses(port: int, deadline: float) -> None:
    """Wrong passwords from another address, each on a connection of its own."""
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError):
            join(port, "guess", source="127.0.0.2", password="wrong").close()


def denied(port: int, deadline: float) -> None:
    """Messages that the access rules deny, each of them a line of the log were it not for its limits."""
    stream = join(port, "denied", password=PASSWORD)
    pour([stream], packet(0x30, text("secret") + b"\x00x") * 5000, deadline)


ATTACKS: tuple[Callable[[int, float], None], ...] = (
    websocket_pings,
    subscribe,
    retained,
    sessions,
    acknowledgements,
    ping_responses,
    subscribers,
    partial_packets,
    guesses,
    denied,
)


@dataclass
class Found:
    """What one attack did.

    ratio, worst: median and 99th percentile of the honest client's round trips, in those of the quiet broker.
    memory: most that the broker had beyond what it had before, MiB. log: MiB written. refused: of the
    honest log-ins.
    """

    attack: str
    quiet_us: float
    ratio: float
    worst: float
    memory: float
    log: float
    refused: str


class Honest:
    """A client that sends itself messages."""

    def __init__(self, port: int, password: str) -> None:
        self._stream = join(port, "honest", password=password)
        self._stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._stream.sendall(packet(0x82, b"\x00\x01\x00" + text("echo") + b"\x00"))
        self._stream.recv(100)

    def round_trips(self, deadline: float) -> list[float]:
        """Seconds of each, until then."""
        found: list[float] = []
        message = packet(0x30, text("echo") + b"\x00" + b"still there?")
        while time.monotonic() < deadline or not found:
            began = time.perf_counter()
            self._stream.sendall(message)
            left = len(message)
            while left > 0:
                left -= len(self._stream.recv(left)) or 10**9
            found.append(time.perf_counter() - began)
            time.sleep(PAUSE)
        return found


@contextlib.contextmanager
def at_work(attack: Callable[[int, float], None], port: int, deadline: float) -> Iterator[None]:
    """While the block runs, a process attacks."""
    process = multiprocessing.get_context("fork").Process(target=attack, args=(port, deadline))
    process.start()
    try:
        yield
    finally:
        process.join(SECONDS)
        process.kill()
        process.join()


def measure(attack: Callable[[int, float], None], *, tls: bool = False) -> Found:
    """One attack on a broker of its own."""
    secured = attack in (guesses, denied)
    password = PASSWORD if secured else ""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        log = Path(folder, "log")
        options = ["--memory", str(BUDGET), "--log", str(log)]
        if tls:
            options += _certificate(Path(folder, "tls"))
        if attack is websocket_pings:
            # Beside a port that is free, as a rule.
            broker = stack.enter_context(_with_websocket(options))
        else:
            broker = stack.enter_context(embedded(*options, *(_accounts(Path(folder)) if secured else ())))
        honest = Honest(broker.port, password)
        until = time.monotonic() + SECONDS / 2
        with at_work(busy, broker.port, until):
            quiet = honest.round_trips(until)
        before, written = peak_memory(broker.pid), _size(log)
        until = time.monotonic() + SECONDS
        refused = "-"
        with at_work(attack, broker.port, until):
            if attack is guesses:
                refused = _log_ins(broker.port, 20)
            found = honest.round_trips(until)
        return Found(
            attack=attack.__name__.replace("_", " "),
            quiet_us=statistics.median(quiet) * 1e6,
            ratio=statistics.median(found) / statistics.median(quiet),
            worst=_high(found) / _high(quiet),
            memory=(peak_memory(broker.pid) - before) * 1e6 / MIB,
            log=(_size(log) - written) / MIB,
            refused=refused,
        )


def _high(values: list[float]) -> float:
    return sorted(values)[int(len(values) * 0.99)]


def _size(file: Path) -> int:
    return sum(path.stat().st_size for path in file.parent.glob(f"{file.name}*"))


def _log_ins(port: int, count: int) -> str:
    refused = 0
    for number in range(count):
        try:
            join(port, f"late-{number}", password=PASSWORD).close()
        except OSError:
            refused += 1
    return f"{refused} of {count}"


@contextlib.contextmanager
def _with_websocket(options: list[str]) -> Iterator[Broker]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with embedded(*options, "--port", str(port), "--websocket-port", str(port + 1)) as broker:
        yield broker


def _certificate(folder: Path) -> list[str]:
    """Options of a broker with TLS; from then on clients of this process connect with it."""
    subprocess.run(
        [*PROGRAM, "broker", "--init", str(folder), "--host", "localhost"], check=True, capture_output=True
    )
    _contexts.append(ssl.create_default_context(cafile=folder / "ca.pem"))
    return ["--certificate", str(folder / "broker.pem"), "--key", str(folder / "broker-key.pem")]


def _accounts(folder: Path) -> list[str]:
    users, access = folder / "users", folder / "access"
    subprocess.run(
        [*PROGRAM, "broker", "--add-user", str(users), "ada"],
        input=f"{PASSWORD}\n",
        text=True,
        check=True,
        capture_output=True,
    )
    access.write_text("user ada\ntopic readwrite echo\n", encoding="utf-8")
    return ["--users", str(users), "--access", str(access)]


def main() -> None:
    """Measure all attacks, or those that are named."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attacks", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE.json", help="where the figures go")
    parser.add_argument("--only", default="", metavar="NAME", help="attacks whose name contains this")
    parser.add_argument("--tls", action="store_true", help="with TLS")
    arguments = parser.parse_args()
    results = [measure(attack, tls=arguments.tls) for attack in ATTACKS if arguments.only in attack.__name__]
    table = Table(title=f"Budget {BUDGET} MiB, load {os.getloadavg()[0]:.1f}", title_justify="left")
    for heading in ("attack", "quiet, us", "median", "99 %", "memory, MiB", "log, MiB", "log-ins refused"):
        table.add_column(heading, justify="left" if heading == "attack" else "right")
    for one in results:
        table.add_row(
            one.attack,
            f"{one.quiet_us:.0f}",
            f"{one.ratio:.2f} x",
            f"{one.worst:.1f} x",
            f"{one.memory:.0f}",
            f"{one.log:.2f}",
            one.refused,
        )
    Console().print(table)
    arguments.file.parent.mkdir(parents=True, exist_ok=True)
    arguments.file.write_text(json.dumps([asdict(one) for one in results], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
