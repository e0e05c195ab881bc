"""One server in a worker of a Ray or Dask cluster: a child process of it, in a process group of its own.

This runs on the cluster. `swarmwright serve` is not run in the worker itself: there, SIGINT and SIGTERM are
the cluster's, and a simulation that crashes would take the worker with it.
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

from swarmwright.servers.launchers._specification import Specification

GRACE_S = 10.0
"""Seconds that a server has to end after SIGTERM."""
_KEPT_LINES = 200
"""Lines kept of what a server prints."""


@dataclass(frozen=True)
class End:
    """How a server ended, and what it printed last."""

    words: str
    lines: Sequence[str] = field(default_factory=tuple)


class Slot:
    """Runs one server.

    Args:
        specification: of the servers.
        server: its id.
        code: folder on this machine that holds the code, if it does not travel.
        base: folder for files of the server; None: the system's for temporary files.
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
        """Run the server to its end, in the calling thread: with that thread the server ends, too."""
        with TemporaryDirectory(prefix="swarmwright-", dir=self._base, ignore_cleanup_errors=True) as folder:
            code = self._unpack(Path(folder))
            with self._lock:
                if self._stopping:
                    return End("was stopped")
                self._process = self._started(folder, code)
            reader = threading.Thread(target=self._read, daemon=True, name="output")
            reader.start()
            status = self._process.wait()
            with suppress(ProcessLookupError):  # what the simulation has started
                os.killpg(self._process.pid, signal.SIGKILL)
            reader.join(2.0)
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        return End(f"{how} on {platform.node()}", tuple(self._lines))

    def where(self) -> str:
        """Return the machine's name: the slot is there."""
        return platform.node()

    def tail(self, lines: int) -> list[str]:
        """Return the last lines that the server has printed."""
        return list(self._lines)[-lines:]

    def stop(self) -> None:
        """Ask the server to end, by SIGTERM; end it by force after GRACE_S. Returns at once."""
        with self._lock:
            again, self._stopping = self._stopping, True
            process = self._process
        if again or process is None:
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

    def _started(self, folder: str, code: str | None) -> "subprocess.Popen[str]":
        variables = self._specification.child_variables(folder, code)
        inherited = os.environ.get("PYTHONPATH")
        if inherited and "PYTHONPATH" in variables:  # packages of the cluster's own environments
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
