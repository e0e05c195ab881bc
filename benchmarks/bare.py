"""The floor: `benchmarks/mqtt`, a client in Rust that encodes by hand and does nothing else."""

import json
import subprocess
from pathlib import Path

from benchmarks.processes import Broker

FOLDER = Path(__file__).parent / "mqtt"
BINARY = FOLDER / "target" / "release" / "mqtt-bare"


def build() -> None:
    """Compile the client, a matter of seconds."""
    subprocess.run(
        ["cargo", "build", "--release", "--quiet", "--manifest-path", str(FOLDER / "Cargo.toml")], check=True
    )


def pingpong(broker: Broker, count: int, sizes: tuple[int, int]) -> float:
    """Mean time of a round trip, there and back through the broker, in us. sizes: bytes there and back."""
    return _run(broker, "pingpong", count, sizes)["mean_us"]


def flood(broker: Broker, count: int, sizes: tuple[int, int]) -> float:
    """Messages per second from one client to one other, at most 500 under way."""
    return _run(broker, "flood", count, (sizes[0], sizes[0]))["messages_per_s"]


def swarm(broker: Broker, count: int, sizes: tuple[int, int], servers: int, agents: int) -> float:
    """Agent-steps per second of `servers` processes with `agents` agents each, `count` steps each."""
    options = ("--servers", str(servers), "--agents", str(agents))
    topics = ("--topic", "bare/sensor", "--back", "bare/actuator")
    return _run(broker, "swarm", count, sizes, *options, *topics)["agent_steps_per_s"]


def _run(broker: Broker, test: str, count: int, sizes: tuple[int, int], *options: str) -> dict[str, float]:
    command = [str(BINARY), test, "--port", str(broker.port), "--count", str(count), "--bytes", str(sizes[0])]
    if test != "flood":
        command += ["--bytes-back", str(sizes[1])]
    result = subprocess.run([*command, *options], check=True, capture_output=True, text=True, timeout=120)
    figures: dict[str, float] = json.loads(result.stdout)
    return figures
