"""Launchers, which start simulation servers on this or other machines.

`LAUNCHERS.names()` lists the launchers for an experiment's `servers`, including plug-ins;
`LAUNCHERS.get("slurm")` returns a class. For custom launchers, derive a class from `Launcher`, see
docs/how-to/use-clusters.md.
"""

from swarmwright.experiment.launchers import LAUNCHERS, LauncherOptions
from swarmwright.servers.launchers._base import Code, Health, Launcher, LauncherError, Specification

__all__ = ["LAUNCHERS", "Code", "Health", "Launcher", "LauncherError", "LauncherOptions", "Specification"]
