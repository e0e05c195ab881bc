"""Sweeps: an experiment in many variants, each with several seeds, on the same servers."""

from swarmwright.analysis.sweep.execution import Outcome, conduct
from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.run import Executor, Listener, Task, list_tasks
from swarmwright.analysis.sweep.variants import Variant

__all__ = ["Executor", "Listener", "Outcome", "Sweep", "Task", "Variant", "conduct", "list_tasks"]
