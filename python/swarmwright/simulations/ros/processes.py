"""Start and end of a simulator, and in ROS 1 of its master."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import Sequence
from urllib.parse import urlparse

_PATIENCE_S = 1.0
"""Seconds that processes have to end after SIGINT."""


class ProcessError(Exception):
    """A process cannot be started, or has ended."""


class Simulator:
    """Processes that run while the robots are connected.

    Args:
        command: command that starts the simulator.
        master: whether to start a ROS 1 master on the port of ROS_MASTER_URI.

    Raises ProcessError if a process cannot be started.
    """

    def __init__(self, command: Sequence[str], *, master: bool) -> None:
        self._processes: list[tuple[str, subprocess.Popen[bytes]]] = []
        if master:
            port = str(urlparse(os.environ["ROS_MASTER_URI"]).port)
            self._start(["roscore", "-p", port], "roscore", quiet=True)
        self._start(command, "simulation.start")

    def _start(self, command: Sequence[str], name: str, *, quiet: bool = False) -> None:
        try:
            started = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL if quiet else sys.stderr,
                start_new_session=True,
            )
        except OSError as error:
            self.end()
            raise ProcessError(f"{name}: {command[0]}: {error.strerror}") from error
        self._processes.append((f"{name}: {command[0]}", started))

    def check(self) -> None:
        """Raise ProcessError if a process has ended."""
        for name, process in self._processes:
            status = process.poll()
            if status is not None:
                how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
                raise ProcessError(f"{name} has ended ({how})")

    def end(self) -> None:
        """Ask the processes to end, and kill them after a while."""
        for number, patience in ((signal.SIGINT, _PATIENCE_S), (signal.SIGKILL, _PATIENCE_S)):
            for _, process in reversed(self._processes):
                with suppress(OSError):
                    os.killpg(process.pid, number)
            deadline = time.monotonic() + patience
            for _, process in self._processes:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline - time.monotonic()))
