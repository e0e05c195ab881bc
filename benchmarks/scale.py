"""`python -m benchmarks.scale`: one tool with 10 to 10,000 servers in virtual time; a broker's memory.

The simulation is `engine/checks/schedules/src/scale.rs`: the real scheduler and the real state machine of
servers, in a simulated network.
"""

import argparse
import contextlib
import json
import os
import resource
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
MINUTE_S, HOUR_S = 60, 3600


class Case(NamedTuple):
    """Servers, seconds of an episode, mean seconds until a server is preempted (None: never)."""

    servers: int
    episode_s: float
    preempted_after_s: int | None = 5 * MINUTE_S


CASES = [
    *(Case(servers, 1.0) for servers in (10, 100, 1_000, 10_000)),
    Case(1_000, 1.0, None),
    Case(100, 0.001),
    Case(1_000, 0.001),
    Case(100, 10.0),
    Case(1_000, 10.0),
    Case(100, MINUTE_S),
    Case(10, HOUR_S, None),
    Case(10, HOUR_S, 24 * HOUR_S),
]
QUICK = [Case(10, 1.0), Case(10, 0.001)]
CONNECTIONS = (0, 1_000, 4_000)
"""The embedded broker admits 4,096."""


def simulate(case: Case, share: int, generations: int) -> dict[str, Any]:
    """Run one case; return the figures of `engine/checks/schedules/src/scale.rs`."""
    manifest = str(ROOT / "engine" / "Cargo.toml")
    subprocess.run(
        [
            *("cargo", "build", "--quiet", "--release", "--manifest-path", manifest),
            "-p",
            "swarmwright-schedules",
        ],
        check=True,
    )
    command = [
        str(ROOT / "engine" / "target" / "release" / "swarmwright-scale"),
        *("--servers", str(case.servers), "--episode", str(round(case.episode_s * 1000))),
        *("--share", str(share), "--generations", str(generations)),
    ]
    if case.preempted_after_s is not None:
        command += ["--preempted-after", str(case.preempted_after_s)]
    used, began = _processor_time(), time.perf_counter()
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, Any] = json.loads(done.stdout)
    # The simulation measures real time; a processor that is shared has this part of it for us.
    part = min(1.0, (_processor_time() - used) / (time.perf_counter() - began))
    for name in ("tool_us_per_evaluation", "tool_load"):
        found[name] *= part
    return found


def _processor_time() -> float:
    """Return the processor time of child processes that have ended, in seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def table(rows: Sequence[tuple[Case, dict[str, Any]]]) -> Table:
    """Return the figures of all cases, a line for each."""
    made = Table(title="One tool, many servers, in virtual time", title_justify="left")
    for name in (
        "servers",
        "episode",
        "preempted every",
        "utilisation",
        "lost",
        "messages/evaluation",
        "discovery/s and server",
        "control/s and server",
        "own/s and server",
        "tool: µs/evaluation",
        "tool: load",
        "tool: MiB",
    ):
        made.add_column(name, justify="right")
    for case, found in rows:
        discovery, control, own = found["heard_per_second"]
        made.add_row(
            f"{case.servers:,}",
            _time(case.episode_s),
            "-" if case.preempted_after_s is None else _time(case.preempted_after_s),
            f"{found['utilisation']:.1%}",
            f"{found['lost']:.1%}",
            f"{found['messages_per_evaluation']:.3g}",
            f"{discovery:.2g}",
            f"{control:.2g}",
            f"{own:.2g}",
            f"{found['tool_us_per_evaluation']:.3g}",
            f"{found['tool_load']:.2g}",
            f"{found['tool_bytes'] / 2**20:.3g}",
        )
    return made


def _time(seconds: float) -> str:
    if seconds < 1:
        return f"{seconds * 1000:g} ms"
    if seconds < MINUTE_S:
        return f"{seconds:g} s"
    return f"{seconds / MINUTE_S:g} min" if seconds < HOUR_S else f"{seconds / HOUR_S:g} h"


def _connect(port: int, number: int) -> socket.socket:
    """Return a connection of MQTT 5 that subscribes to what a server subscribes to."""

    def text(value: str) -> bytes:
        return struct.pack(">H", len(value)) + value.encode()

    def packet(kind: int, body: bytes) -> bytes:
        size, length = b"", len(body)
        while True:
            length, digit = divmod(length, 128)
            size += bytes([digit | (0x80 if length else 0)])
            if not length:
                return bytes([kind]) + size + body

    filters = [
        *("discovery", "parameters", "control", "actuator"),
        *(f"swarmwright/v1/server/{number}", f"swarmwright/v1/presence/{number}"),
    ]
    made = socket.create_connection(("127.0.0.1", port), timeout=60)
    made.sendall(
        packet(0x10, text("MQTT") + b"\5\2" + struct.pack(">H", 600) + b"\0" + text(f"server-{number}"))
        + packet(0x82, struct.pack(">H", 1) + b"\0" + b"".join(text(name) + b"\0" for name in filters))
    )
    made.recv(4)
    return made


def broker_memory(counts: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield for numbers of connected, silent servers the bytes of memory of a process with the broker."""
    with contextlib.ExitStack() as stack:
        process = subprocess.Popen(
            [sys.executable, "-m", "swarmwright", "broker", "--port", "0", "--json"],
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(process.wait)
        stack.callback(process.terminate)
        assert process.stdout is not None
        stack.enter_context(process.stdout)
        port = int(json.loads(process.stdout.readline())["port"])
        made = 0
        for count in counts:
            for number in range(made, count):
                stack.callback(_connect(port, number + 1).close)
            made = count
            time.sleep(1.0)
            pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
            yield count, pages * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few servers: does it work?")
    arguments = parser.parse_args()
    cases = QUICK if arguments.quick else CASES
    rows = []
    for case in cases:
        # Short episodes travel in blocks: a server needs work for many of them.
        share = 16 if case.episode_s >= 1 else min(round(16 / case.episode_s), 2_000_000 // case.servers)
        rows.append((case, simulate(case, 4 if case.servers > 1_000 else share, 2)))
    Console(width=180).print(table(rows))
    for connections, size in broker_memory(CONNECTIONS[:1] if arguments.quick else CONNECTIONS):
        print(f"broker with {connections:,} servers: {size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
