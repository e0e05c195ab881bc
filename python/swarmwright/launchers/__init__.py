"""What starts simulation servers, here or elsewhere: one file and one line below for each launcher."""

from swarmwright.core.registry import Registry
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
