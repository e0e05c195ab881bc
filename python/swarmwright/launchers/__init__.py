"""Launchers: they start simulation servers, on this machine or elsewhere.

`LAUNCHERS.names()` lists those that an experiment's `servers` may name, those of plug-ins included;
`LAUNCHERS.get("slurm")` is the class of one. A custom launcher is a class derived from `Launcher`:
docs/how-to/use-clusters.md.
"""

from swarmwright.common.registry import Registry
from swarmwright.launchers._base import Health, Launcher, LauncherError, LauncherOptions
from swarmwright.launchers._code import Code
from swarmwright.launchers._specification import Specification

__all__ = ["LAUNCHERS", "Code", "Health", "Launcher", "LauncherError", "LauncherOptions", "Specification"]

LAUNCHERS: Registry[Launcher] = Registry(
    "launcher",
    "swarmwright.launchers",
    {
        "dask": "swarmwright.launchers.dask:Dask",
        "kubernetes": "swarmwright.launchers.kubernetes:Kubernetes",
        "process": "swarmwright.launchers.process:Process",
        "ray": "swarmwright.launchers.ray:Ray",
        "slurm": "swarmwright.launchers.slurm:Slurm",
        "ssh": "swarmwright.launchers.ssh:Ssh",
    },
    "swarmwright.launchers:Launcher",
)
"""All launchers, by the `launcher` of an entry of an experiment's `servers`."""
