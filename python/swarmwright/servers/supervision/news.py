"""News of a supervisor about its servers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmwright.servers.supervision.server_exit import ServerExit


@dataclass(frozen=True)
class ServerEvent:
    """A report of a server: `ready`, `busy`, `warning`, `failure`, `lost` or `error`."""

    server: int
    pid: int
    report: Mapping[str, Any]


@dataclass(frozen=True)
class ServerEnd:
    """A server's process has ended unexpectedly.

    pause: seconds until its restart; None if it is not restarted.
    """

    server_exit: ServerExit
    pause: float | None


@dataclass(frozen=True)
class ServerRestart:
    """A server was restarted."""

    server: int
    pid: int


News = ServerEvent | ServerEnd | ServerRestart
