"""Supervision of simulation servers in their own processes."""

from swarmwright.servers.supervision.output import Output, listening_to_output
from swarmwright.servers.supervision.server_exit import (
    News,
    ServerEnd,
    ServerEvent,
    ServerExit,
    ServerRestart,
    signal_name,
)
from swarmwright.servers.supervision.supervisor import Supervisor

__all__ = [
    "News",
    "Output",
    "ServerEnd",
    "ServerEvent",
    "ServerExit",
    "ServerRestart",
    "Supervisor",
    "listening_to_output",
    "signal_name",
]
