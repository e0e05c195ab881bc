"""A domain of DDS on this machine alone, an exported package with its nodes, and a robot that they steer."""

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml

from swarmwright.export.exporting import write
from swarmwright.export.ros import Ros2
from swarmwright.export.subject import Subject
from tests.python.simulations.ros.conversation import EXPORTED
from tests.python.simulations.ros.mistakes import FLOAT, ODOMETRY, RANGE, SCAN, TWIST

TYPES = {"scan": SCAN, "sonar": RANGE, "odom": ODOMETRY, "light": FLOAT, "target": TWIST}
_LOOPBACK = (
    "<General><Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='localhost'/></Peers>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery>"
)
SETUP = os.environ.get("SWARMWRIGHT_ROS2")
"""`setup.bash` of a ROS 2, with whose nodes conversations are held, too."""


def environment(domain: int | None = None) -> dict[str, str]:
    """The environment of a node in a domain of its own, whatever networks the machine has."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "CYCLONEDDS"))}
    # Ports of greater numbers are those of others.
    number = random.randrange(102) if domain is None else domain
    return {**kept, "ROS_DOMAIN_ID": str(number), "CYCLONEDDS_URI": _LOOPBACK}


class Package:
    """An exported package, and how its nodes are started."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "src" / "rover"
        write(Ros2().files(Subject(EXPORTED), "rover"), self.folder)
        self.environment = environment()
        self._workspace = folder

    def build(self) -> None:
        """Build it with ROS 2."""
        self._with_ros(
            "colcon build --cmake-args -DBUILD_TESTING=OFF '-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror'"
        )

    def _with_ros(self, command: str) -> None:
        done = subprocess.run(
            ["bash", "-c", f"source {SETUP} && {command}"], cwd=self._workspace, capture_output=True,
            text=True, check=False, timeout=500,
        )  # fmt: skip
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"

    def command(self, kind: str, mapping: Path | None, robot: str, *others: str) -> list[str]:
        """What starts a node: `dds`, `cpp` or `python`."""
        if kind == "dds":
            given = [] if mapping is None else ["--mapping", str(mapping)]
            return [sys.executable, "-m", "rover.dds_node", *given, "--robot", robot, *others]
        arguments = "" if mapping is None else f"-p mapping:={mapping}"
        sim = "-p use_sim_time:=true" if "--use-sim-time" in others else ""
        words = f"--ros-args -r __ns:=/{robot.strip('/')} {arguments} {sim}"
        program = f"{self._workspace}/install/rover/lib/rover/swarmwright_controller_{kind}"
        if kind.startswith("launch"):
            program = "ros2 launch rover controller.launch.py"
            words = f"robot:={robot} mapping:={mapping} node:={kind.partition('-')[2]}"
        return self.sourced(f"{program} {words}")

    def sourced(self, command: str) -> list[str]:
        """A command with what was built."""
        kept = ("ROS_DOMAIN_ID", "CYCLONEDDS_URI")
        keep = " ".join(f"{name}={json.dumps(self.environment[name])}" for name in kept)
        setups = f"source {SETUP} && source {self._workspace}/install/setup.bash"
        return ["bash", "-c", f"{setups} && export {keep} && exec {command}"]


class Robot:
    """`peer.py` as one robot, or `peer_rclpy.py`: its topics in the robot's namespace."""

    def __init__(self, package: Package, *, rclpy: bool = False) -> None:
        self.package = package
        self.name = f"/robot_{random.getrandbits(48):x}"  # nobody else's, should a domain be shared
        program = Path(__file__).with_name("peer_rclpy.py" if rclpy else "peer.py")
        self._command = package.sourced(f"python3 {program}") if rclpy else [sys.executable, str(program)]

    def __enter__(self) -> Self:
        """Start it."""
        self._process = subprocess.Popen(
            self._command, env=self.package.environment, text=True, start_new_session=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        end(self._process)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def __call__(self, do: str, **arguments: Any) -> Any:
        """Have something done; what came of it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([do, arguments]) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        assert answer, "the peer has ended"
        return json.loads(answer)

    def publish(self, row: dict[str, Any], reliable: bool = True) -> None:
        """Publish messages, by topic, from now on."""
        for topic, message in row.items():
            kind = TYPES[topic].replace("/", "/msg/")
            self("publish", topic=f"{self.name}/{topic}", kind=kind, message=message, reliable=reliable)

    def silence(self, topic: str) -> None:
        """Publish no more on a topic."""
        self("silence", topic=f"{self.name}/{topic}")

    def record(self, topic: str, kind: str) -> None:
        """Record a topic from now on."""
        self("record", topic=f"{self.name}/{topic}", kind=kind.replace("/", "/msg/"))

    def record_all(self) -> None:
        """Record commands and steps."""
        self.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        self.record("cmd_vel", TWIST)
        self.record("gripper", FLOAT)

    def recorded(self, topic: str) -> list[Any]:
        """What was recorded of a topic."""
        found: list[Any] = self("recorded", topic=f"{self.name}/{topic}")
        return found

    def driven(self) -> list[tuple[float, float]]:
        """linear.x and angular.z of all commands."""
        return [(one["linear"]["x"], one["angular"]["z"]) for one in self.recorded("cmd_vel")]

    def steps(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """(steps, sensors + actuators)."""
        data = [step["data"] for step in self.recorded("swarmwright_controller/steps")]
        return np.array(data, np.float32).reshape(len(data), 10)


class Node:
    """A running node, and what it says."""

    def __init__(self, process: "subprocess.Popen[bytes]", output: Path) -> None:
        self.process, self._output = process, output

    def said(self) -> str:
        """All of it so far."""
        return self._output.read_text(encoding="utf-8")


@contextmanager
def node(
    kind: str, robot: Robot, mapping: "dict[str, Any] | str | None", folder: Path, *others: str,
    environment: dict[str, str] | None = None,
) -> Iterator[Node]:  # fmt: skip
    """A node with a mapping, or the text of one, in the namespace of a robot.

    kind: `dds`, `cpp`, `python` or `launch-..`; what follows a + is how the robot is played.
    """
    file = folder / "mapping.yaml"
    if mapping is not None:
        file.write_text(mapping if isinstance(mapping, str) else yaml.safe_dump(mapping), encoding="utf-8")
    command = robot.package.command(
        kind.partition("+")[0], None if mapping is None else file, robot.name, *others
    )
    output = folder / "said.txt"
    with output.open("wb") as stream:
        process = subprocess.Popen(
            command, cwd=robot.package.folder, env=environment or robot.package.environment,
            stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
    try:
        yield Node(process, output)
    finally:
        end(process)
        print(output.read_text(encoding="utf-8"))


def end(process: "subprocess.Popen[Any]", number: int = signal.SIGINT) -> None:
    """End a process and all that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)
    with suppress(subprocess.TimeoutExpired):
        process.wait(10)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
