"""Simulation servers in processes of their own: started, watched, started again, ended."""

from swarmwright.supervision.output import Output, listening_to_output
from swarmwright.supervision.server_exit import ServerExit, signal_name
from swarmwright.supervision.supervisor import Ended, Event, Restarted, Supervisor

__all__ = [
    "Ended",
    "Event",
    "Output",
    "Restarted",
    "ServerExit",
    "Supervisor",
    "listening_to_output",
    "signal_name",
]
