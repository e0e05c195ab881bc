"""Servers on a Ray cluster, one actor each (https://docs.ray.io)."""

import os
from typing import Any, ClassVar, Literal

from pydantic import Field

from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._driven import DrivenLauncher


class RayOptions(LauncherOptions):
    """An existing Ray cluster."""

    launcher: Literal["ray"] = "ray"
    address: str | None = Field(default=None, min_length=1)
    """Address of the cluster: host:6379 on one of its nodes, ray://head:10001 from elsewhere, or `auto` for
    the cluster of this machine. Default: the environment variable RAY_ADDRESS, else `auto`."""
    num_cpus: float = Field(default=1.0, ge=0, allow_inf_nan=False)
    """Processors that Ray reserves for each server."""
    num_gpus: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    """GPUs that Ray reserves for each server."""
    memory: int | None = Field(default=None, ge=1)
    """Bytes of memory that Ray reserves for each server. Default: none."""
    resources: dict[str, float] = Field(default={})
    """Custom resources of nodes that each server takes, such as {simulator: 1}."""
    runtime_env: dict[str, Any] = Field(default={})
    """Runtime environment of the actors, as Ray documents it, such as {pip: [swarmwright, shapely]}."""


class Ray(DrivenLauncher):
    """Servers on a Ray cluster, one actor each.

    Ray places the actors, on nodes that its autoscaler adds if there is one. An actor runs
    `swarmwright serve` as a child process, which ends with it; actors end with the connection to the cluster.
    """

    kind: ClassVar[str] = "ray"
    options_model = RayOptions
    options: RayOptions
    library: ClassVar[str] = "ray"
    cluster: ClassVar[str] = "swarmwright.servers.launchers._ray_cluster"

    def address(self) -> str | None:
        """Return the address, unless Ray finds it."""
        found = self.options.address or os.environ.get("RAY_ADDRESS", "auto")
        return None if found == "auto" else found
