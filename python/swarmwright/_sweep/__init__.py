"""Sweeps: an experiment in many variants, each with several seeds, on the same servers."""

from swarmwright._sweep._file import Sweep, Variant
from swarmwright._sweep._run import Crew, Task, tasks

__all__ = ["Crew", "Sweep", "Task", "Variant", "tasks"]
