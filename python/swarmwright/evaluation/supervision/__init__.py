"""Simulation servers in processes of their own: started, watched, started again, ended."""

from swarmwright.evaluation.supervision.death import Death, signal_name
from swarmwright.evaluation.supervision.output import Output, listening_to_output
from swarmwright.evaluation.supervision.supervisor import Ended, Event, Restarted, Supervisor

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
