"""Simulation servers that a run starts for itself, each in its own process, none left behind."""

import json
import logging
import os
import selectors
import subprocess
import sys
import time
from tempfile import TemporaryFile
from types import TracebackType
from typing import IO, Any, Self

from swarmwright._errors import RunError

GRACE = 5.0
"""Seconds that servers have to say good-bye."""
START = 30.0
"""Seconds that servers have to start."""
_LAST_WORDS = 4000

_log = logging.getLogger("swarmwright")


def automatic_count() -> int:
    """Return how many servers suit this machine: one per processor, at least 2 and at most 8."""
    return min(max(os.cpu_count() or 1, 2), 8)


class _Server:
    def __init__(self, settings: dict[str, Any], *, visual: bool) -> None:
        self.identifier: int = settings["id"]
        self.missed = False
        self._stderr: IO[bytes] = TemporaryFile()  # noqa: SIM115 - closed in `close`
        self.ready, writing = os.pipe()
        try:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "swarmwright._server_process",
                    str(writing),
                    json.dumps(settings),
                ],
                stdin=subprocess.PIPE,
                stdout=None if visual else subprocess.DEVNULL,
                stderr=self._stderr,
                pass_fds=[writing],
                process_group=0,  # Ctrl-C reaches the parent alone, which then ends its servers in order
            )
        except BaseException:
            os.close(self.ready)
            self._stderr.close()
            raise
        finally:
            os.close(writing)

    def last_words(self) -> str:
        """Return what the process wrote to standard error last."""
        end = self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, end - _LAST_WORDS))
        return self._stderr.read().decode(errors="replace").strip()

    def obituary(self) -> str:
        """Say how the process ended."""
        status = self.process.returncode
        how = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
        words = self.last_words()
        return f"simulation server {self.identifier} {how}" + (f":\n{words}" if words else "")

    def dismiss(self) -> None:
        """Ask the process to end."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            self.process.stdin.close()

    def close(self) -> None:
        """See the process off."""
        self.dismiss()
        try:
            self.process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.stop_listening()
        self._stderr.close()

    def stop_listening(self) -> None:
        """Close the pipe of events: one that nobody reads would fill up."""
        if self.ready >= 0:
            os.close(self.ready)
            self.ready = -1


class LocalServers:
    """Server processes for the time of a `with` block.

    Args:
        settings: the arguments of `_engine.serve`, one mapping per server; a simulation in Python by its
            class.
        visual: let the servers draw on this process's standard output.

    Raises:
        RunError: on entry, when a server does not start; the message holds its last words.

    """

    def __init__(self, settings: list[dict[str, Any]], *, visual: bool = False) -> None:
        self._settings = settings
        self._visual = visual
        self._servers: list[_Server] = []

    def __enter__(self) -> Self:
        try:
            for settings in self._settings:
                self._servers.append(_Server(settings, visual=self._visual))
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pids(self) -> list[int]:
        """Process ids."""
        return [server.process.pid for server in self._servers]

    def close(self) -> None:
        """End all servers: ask all, then wait for each, then kill."""
        for server in self._servers:
            server.dismiss()
        while self._servers:
            self._servers.pop().close()

    def check(self) -> None:
        """Log servers that have ended since the last check; raise RunError when none is left."""
        for server in self._servers:
            if not server.missed and server.process.poll() is not None:
                server.missed = True
                _log.warning("%s", server.obituary())
        if self._servers and all(server.missed for server in self._servers):
            endings = "\n".join(server.obituary() for server in self._servers)
            raise RunError(f"no simulation server is left:\n{endings}")

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + START
        with selectors.DefaultSelector() as selector:
            for server in self._servers:
                selector.register(server.ready, selectors.EVENT_READ, server)
            while selector.get_map():
                ready = selector.select(max(0.0, deadline - time.monotonic()))
                if not ready:
                    raise RunError(f"a simulation server did not start within {START:g} s")
                for key, _ in ready:
                    selector.unregister(key.fd)
                    server = key.data
                    # The first line says how it went; of what comes later nothing is wanted here.
                    line = os.read(key.fd, 4096).partition(b"\n")[0]
                    if not line or json.loads(line).get("event") != "ready":
                        server.process.wait()
                        raise RunError(server.obituary())
                    server.stop_listening()
