"""Sweeps: an experiment in many variants, each with several seeds, on the same servers."""

from swarmwright._sweep._course import Listener, Outcome, conduct
from swarmwright._sweep._file import Sweep, Variant
from swarmwright._sweep._run import Crew, Task, tasks

__all__ = ["Crew", "Listener", "Outcome", "Sweep", "Task", "Variant", "conduct", "tasks"]
