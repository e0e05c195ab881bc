"""Simulation servers in processes of their own: started, watched, started again, ended."""

from swarmwright._supervision._death import Death, signal_name
from swarmwright._supervision._output import Output, listening_to_output
from swarmwright._supervision._supervisor import Ended, Event, Restarted, Supervisor

__all__ = [
    "Death",
    "Ended",
    "Event",
    "Output",
    "Restarted",
    "Supervisor",
    "listening_to_output",
    "signal_name",
]
