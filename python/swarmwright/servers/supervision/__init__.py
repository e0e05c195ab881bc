"""Simulation servers in processes of their own: started, watched, started again, ended."""

from swarmwright.servers.supervision.news import Ended, Event, News, Restarted
from swarmwright.servers.supervision.output import Output, listening_to_output
from swarmwright.servers.supervision.server_exit import ServerExit, signal_name
from swarmwright.servers.supervision.supervisor import Supervisor

__all__ = [
    "Ended",
    "Event",
    "News",
    "Output",
    "Restarted",
    "ServerExit",
    "Supervisor",
    "listening_to_output",
    "signal_name",
]
