"""What a supervisor tells about its servers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmwright.servers.supervision.server_exit import ServerExit


@dataclass(frozen=True)
class Event:
    """Something that a server reported: `ready`, `busy`, `warning`, `failure`, `lost` or `error`."""

    server: int
    pid: int
    report: Mapping[str, Any]


@dataclass(frozen=True)
class Ended:
    """A server's process has ended without being asked to.

    pause: seconds after which it is started again; None when it is not.
    """

    server_exit: ServerExit
    pause: float | None


@dataclass(frozen=True)
class Restarted:
    """A server was started again."""

    server: int
    pid: int


News = Event | Ended | Restarted
