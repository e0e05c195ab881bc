"""Launchers: they start simulation servers, on this machine or elsewhere.

`LAUNCHERS.names()` lists those that an experiment's `servers` may name, those of plug-ins included;
`LAUNCHERS.get("slurm")` is the class of one. A custom launcher is a class derived from `Launcher`:
docs/how-to/use-clusters.md.
"""

from swarmwright.experiment.launchers import LAUNCHERS, LauncherOptions
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError
from swarmwright.servers.launchers._code import Code
from swarmwright.servers.launchers._specification import Specification

__all__ = ["LAUNCHERS", "Code", "Health", "Launcher", "LauncherError", "LauncherOptions", "Specification"]
