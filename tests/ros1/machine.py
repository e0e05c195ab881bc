"""A workspace, a roscore on a free port, and a node that publishes and records what tests tell it."""

import json
import os
import signal
import socket
import subprocess
import time
import xmlrpc.client
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from swarmwright.export.c import C
from swarmwright.export.ros import Ros1
from swarmwright.export.subject import Subject
from tests.python.cli.processes import children
from tests.python.export.specifications import Specification, network
from tests.python.simulations.ros.conversation import EXPORTED

ROOT = Path(__file__).parents[2]


class Workspace:
    """A catkin workspace, built when it is made."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "src").mkdir()
        (folder / "home").mkdir()
        (folder / "src" / "emergency_exit").symlink_to(ROOT / "wrappers" / "ros1" / "emergency_exit")
        self.include(network("layered", "tanh", [-1.0, 1.0], sensors=10))
        _write(Ros1().files(Subject(EXPORTED), "rover"), folder / "src" / "rover")
        # Debian's programs before others of the same names, such as another Python.
        clean = {"PATH": "/usr/bin:/bin", "HOME": str(folder / "home"), "LC_ALL": "C.UTF-8"}
        self.environment = clean
        self.run(
            "catkin_make", "-DPYTHON_EXECUTABLE=/usr/bin/python3",
            f"-DCONTROLLER_DIR={folder / 'controller'}", "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror",
        )  # fmt: skip
        sourced = self.run("bash", "-c", "source devel/setup.bash && env -0")
        self.environment = {
            **dict(pair.split("=", 1) for pair in sourced.rstrip("\0").split("\0")),
            "ROS_HOME": str(folder / "home"),
            "ROS_LOG_DIR": str(folder / "home" / "log"),
            "ROS_IP": "127.0.0.1",
            "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1",
        }

    def include(self, specification: Specification) -> None:
        """Export a controller to where the agents include it from; nothing is compiled yet."""
        _write(C().files(Subject(specification), "controller"), self.folder / "controller")

    def compile(self, specification: Specification) -> None:
        """Have the agents run a controller."""
        self.include(specification)
        self.run("make", "-C", "build", "emergency_exit_agent")

    def run(self, *command: str, expected: int = 0) -> str:
        """Run a command in the workspace to its end; what it said on standard output."""
        done = subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=200,
            check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert done.returncode == expected, f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def start(self, *command: str, **streams: Any) -> "subprocess.Popen[str]":
        """Start a command in a group of its own."""
        return subprocess.Popen(
            command, cwd=self.folder, env=self.environment, text=True, start_new_session=True, **streams
        )


def _write(files: dict[str, str | bytes], folder: Path) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def end(process: "subprocess.Popen[str]", number: int = signal.SIGINT) -> None:
    """End a process and all that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)
    with suppress(subprocess.TimeoutExpired):
        process.wait(20)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class Master:
    """roscore on a free port."""

    def __init__(self, workspace: Workspace) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1]
        self.workspace = workspace
        workspace.environment["ROS_MASTER_URI"] = f"http://127.0.0.1:{self._port}"

    def __enter__(self) -> Self:
        """Start it and wait until it answers."""
        self._process = self.workspace.start(
            "roscore", "-p", str(self._port), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        uri, deadline = f"http://127.0.0.1:{self._port}", time.monotonic() + 30
        while True:
            with suppress(OSError), xmlrpc.client.ServerProxy(uri) as proxy:
                if proxy.lookupNode("/test", "/rosout")[0] == 1:  # type: ignore[index] # [code, text, value]
                    return self
            assert self._process.poll() is None, "roscore has ended"
            assert time.monotonic() < deadline, "roscore does not answer"
            time.sleep(0.05)

    def kill(self) -> None:
        """End it at once, with the master that it has started in a group of its own."""
        for process in children(self._process.pid):
            os.kill(process, signal.SIGKILL)
        end(self._process, signal.SIGKILL)

    def __exit__(self, *_: object) -> None:
        """End it."""
        end(self._process)


class Driver:
    """`driver.py`, told what to do line by line."""

    def __init__(self, master: Master) -> None:
        self._workspace = master.workspace

    def __enter__(self) -> Self:
        """Start it."""
        program = str(Path(__file__).with_name("driver.py"))
        self._process = self._workspace.start(
            "/usr/bin/python3", program, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
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
        assert answer, "the driver has ended"
        return json.loads(answer)
