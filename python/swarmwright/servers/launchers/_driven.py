"""Launchers that run a cluster's client library in a separate process."""

import importlib.util
import os
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, ClassVar
from urllib.parse import urlsplit

from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError, Specification
from swarmwright.servers.launchers._slot import GRACE_S

_CONNECT_S = 10.0
"""Time limit for connecting to a cluster's address, seconds."""
_KEPT_LINES = 40
"""Output lines kept of the driver."""


class DrivenLauncher(Launcher):
    """Base class of launchers whose cluster library runs in a separate process, see `_driver`."""

    library: ClassVar[str]
    """The required module."""
    cluster: ClassVar[str]
    """The module with the class `Cluster`, which takes options and specification."""

    def __init__(self, options: Any, specification: Specification) -> None:  # noqa: ANN401 - each has its own
        super().__init__(options, specification)
        self._process: subprocess.Popen[str] | None = None
        self._pipe: Connection[Any, Any] | None = None
        self._output: deque[str] = deque(maxlen=_KEPT_LINES)
        self._number = 0
        self._servers: set[int] = set()
        self._lost: dict[int, str] = {}

    def open(self) -> None:
        """Connect to the cluster.

        Raises:
            InputError: the cluster's library is not installed.
            LauncherError: the cluster is missing or refuses the connection.
        """
        if importlib.util.find_spec(self.library) is None:
            raise InputError(
                f"servers: {self.kind} needs the package {self.library}: "
                f"pip install 'swarmwright[{self.kind}]'"
            )
        self._connect()

    def start(self, servers: Sequence[int]) -> None:
        """Submit servers to the cluster, which starts them as resources allow."""
        self._reconnect()
        self._call("start", list(servers))
        self._servers.update(servers)

    def health(self) -> Mapping[int, Health]:
        """Return the states of all servers."""
        self._reconnect()
        states = dict(self._call("health")) if self._servers - set(self._lost) else {}
        return states | {server: Health("ended", words) for server, words in self._lost.items()}

    def stop(self, servers: Sequence[int]) -> None:
        """End servers."""
        for server in servers:
            self._lost.pop(server, None)
            self._servers.discard(server)
        if self._pipe is not None:
            self._call("stop", list(servers), most=3 * GRACE_S)

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the last lines of a server."""
        return () if self._pipe is None or server in self._lost else self._call("logs", server, lines)

    def close(self) -> None:
        """End all servers and the connection."""
        if self._pipe is None:
            return
        try:
            self._call("close", most=4 * GRACE_S)
        finally:
            self._end()

    def address(self) -> str | None:
        """Return the address of the cluster for a quick connection test; None if unknown."""
        return None

    def _connect(self) -> None:
        self._check_address()
        parent_end, child_end = socket.socketpair()
        with child_end:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "swarmwright.servers.launchers._driver",
                    str(child_end.fileno()),
                    str(os.getpid()),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                pass_fds=[child_end.fileno()],
                start_new_session=True,  # Ctrl+C reaches only the tool, which ends servers in order
            )
        self._pipe = Connection(parent_end.detach())
        threading.Thread(target=self._read, args=(self._process,), daemon=True, name=self.kind).start()
        try:
            self._call("open", self.cluster, self.options, self.specification)
        except LauncherError as error:
            self._end()
            raise LauncherError(f"cannot use the cluster: {error}") from error

    def _check_address(self) -> None:
        """Raise LauncherError unless the cluster's address accepts connections."""
        address = self.address()
        if address is None:
            return
        parts = urlsplit(address if "://" in address else f"//{address}")
        try:
            host, port = parts.hostname, parts.port
            if host is None or port is None:
                raise ValueError
        except ValueError:
            raise LauncherError(f"address: {address} must have a host and a port") from None
        try:
            socket.create_connection((host, port), _CONNECT_S).close()
        except OSError as error:
            words = error.strerror or str(error)
            raise LauncherError(
                f"address: {address} cannot be reached: {words}; check that the cluster is running"
            ) from None

    def _reconnect(self) -> None:
        """Reconnect if the client has ended, and with it its servers."""
        if self._pipe is None:
            self._connect()

    def _call(self, name: str, *arguments: Any, most: float | None = None) -> Any:  # noqa: ANN401 - of the cluster
        pipe = self._pipe
        if pipe is None:
            raise LauncherError("the connection to the cluster is closed")
        self._number += 1
        limit = self.options.start_timeout if most is None else most
        try:
            pipe.send((self._number, name, arguments))
            while pipe.poll(limit):
                number, done, answer = pipe.recv()
                if number < self._number:  # a late one
                    continue
                if not done:
                    raise LauncherError(answer)
                return answer
        except (EOFError, OSError):
            self._end()
            words = "\n".join(["the connection to the cluster was lost", *list(self._output)[-5:]])
            self._lost.update(dict.fromkeys(self._servers, "ended with the connection to the cluster"))
            raise LauncherError(words) from None
        raise LauncherError(f"the cluster did not answer within {limit:g} s")

    def _end(self) -> None:
        """End the client."""
        pipe, self._pipe = self._pipe, None
        if pipe is not None:
            pipe.close()
        process, self._process = self._process, None
        if process is None:
            return
        with suppress(subprocess.TimeoutExpired):
            process.wait(2 * GRACE_S)
        process.kill()
        process.wait()

    def _read(self, process: "subprocess.Popen[str]") -> None:
        assert process.stderr is not None
        with process.stderr as stream:
            for line in stream:
                self._output.append(line.rstrip("\n"))
