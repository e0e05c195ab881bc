"""The simulator that is started with its robots, and in ROS 1 a master for it."""

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
"""Seconds that it has to end when it is asked to, as on Ctrl-C."""


class ProcessError(Exception):
    """A process cannot be started, or has ended; the message says which and why."""


class Simulator:
    """Processes that run as long as the robots are connected.

    Args:
        command: starts the simulator.
        master: whether it needs a master of ROS 1, on the port of ROS_MASTER_URI.

    Raises ProcessError when one cannot be started.
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
        """Raise ProcessError when one has ended."""
        for name, process in self._processes:
            status = process.poll()
            if status is not None:
                how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
                raise ProcessError(f"{name} has ended ({how})")

    def end(self) -> None:
        """End them: they are asked to, and after a while killed."""
        for number, patience in ((signal.SIGINT, _PATIENCE_S), (signal.SIGKILL, _PATIENCE_S)):
            for _, process in reversed(self._processes):
                with suppress(OSError):
                    os.killpg(process.pid, number)
            deadline = time.monotonic() + patience
            for _, process in self._processes:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline - time.monotonic()))
