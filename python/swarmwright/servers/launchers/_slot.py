"""A server as a child process of a worker of a Ray or Dask cluster, in its own process group.

This runs on the cluster. `swarmwright serve` does not run in the worker itself, whose SIGINT and SIGTERM
belong to the cluster and which must survive a crashing simulation.
"""

import os
import platform
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmwright.servers.launchers._base import Specification

GRACE_S = 10.0
"""Seconds for a server to end after SIGTERM."""
_KEPT_LINES = 200
"""Output lines kept of a server."""


@dataclass(frozen=True)
class End:
    """The end of a server and its last output."""

    words: str
    lines: Sequence[str] = field(default_factory=tuple)


class Slot:
    """Runner of one server.

    Args:
        specification: specification of the servers.
        server: its id.
        code: folder on this machine with the code, if the code is not copied.
        base: folder for files of the server; None for the system's temporary folder.
    """

    def __init__(
        self, specification: Specification, server: int, code: str | None, base: str | None = None
    ) -> None:
        self._specification, self._server, self._code, self._base = specification, server, code, base
        self._lines: deque[str] = deque(maxlen=_KEPT_LINES)
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._stopping = False

    def run(self) -> End:
        """Run the server until it ends; it also ends with the calling thread."""
        with TemporaryDirectory(prefix="swarmwright-", dir=self._base, ignore_cleanup_errors=True) as folder:
            code = self._unpack(Path(folder))
            with self._lock:
                if self._stopping:
                    return End("was stopped")
                self._process = self._start_process(folder, code)
            reader = threading.Thread(target=self._read, daemon=True, name="output")
            reader.start()
            status = self._process.wait()
            with suppress(ProcessLookupError):  # processes that the simulation started
                os.killpg(self._process.pid, signal.SIGKILL)
            reader.join(2.0)
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        return End(f"{how} on {platform.node()}", tuple(self._lines))

    def node_name(self) -> str:
        """Return the name of the slot's machine."""
        return platform.node()

    def tail(self, lines: int) -> list[str]:
        """Return the server's last output lines."""
        return list(self._lines)[-lines:]

    def stop(self) -> None:
        """Send SIGTERM to the server, and SIGKILL after GRACE_S. Returns at once."""
        with self._lock:
            was_stopping, self._stopping = self._stopping, True
            process = self._process
        if was_stopping or process is None:
            return
        process.terminate()
        timer = threading.Timer(GRACE_S, process.kill)
        timer.daemon = True
        timer.start()

    def _unpack(self, folder: Path) -> str | None:
        specification = self._specification
        for name, data in specification.files().items():
            (folder / name).touch(0o600)
            (folder / name).write_bytes(data)
        if specification.code is None:
            return self._code
        specification.code.unpack(folder / "code")
        return str(folder / "code")

    def _start_process(self, folder: str, code: str | None) -> "subprocess.Popen[str]":
        variables = self._specification.child_variables(folder, code)
        inherited = os.environ.get("PYTHONPATH")
        if inherited and "PYTHONPATH" in variables:  # packages of the cluster's environment
            variables["PYTHONPATH"] += os.pathsep + inherited
        program = [sys.executable, "-m", "swarmwright.servers.launchers._tied", str(os.getpid()), folder]
        return subprocess.Popen(
            [*program, *self._specification.arguments(self._server)],
            cwd=code or folder,
            env={**os.environ, **variables},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )

    def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.append(line.rstrip("\n"))
                print(line, end="", flush=True)  # into the worker's log
