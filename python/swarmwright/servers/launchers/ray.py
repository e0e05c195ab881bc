"""Servers as actors on a Ray cluster (https://docs.ray.io)."""

import os
from typing import Any, ClassVar, Literal

from pydantic import Field

from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._driven import DrivenLauncher


class RayOptions(LauncherOptions):
    """An existing Ray cluster."""

    launcher: Literal["ray"] = "ray"
    address: str | None = Field(default=None, min_length=1)
    """Address of the cluster: host:6379 on its nodes, ray://head:10001 from other machines, `auto` for this
    machine's cluster. Default: the environment variable RAY_ADDRESS, else `auto`."""
    num_cpus: float = Field(default=1.0, ge=0, allow_inf_nan=False)
    """Processors reserved per server."""
    num_gpus: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    """GPUs reserved per server."""
    memory: int | None = Field(default=None, ge=1)
    """Memory reserved per server, bytes. Default: none."""
    resources: dict[str, float] = Field(default={})
    """Custom node resources per server, such as {simulator: 1}."""
    runtime_env: dict[str, Any] = Field(default={})
    """Ray's runtime environment of the actors, such as {pip: [swarmwright, shapely]}."""


class Ray(DrivenLauncher):
    """Launcher of servers on a Ray cluster, one actor each.

    Ray places the actors, including on nodes of its autoscaler. An actor runs `swarmwright serve` as a child
    process; actors end with the connection to the cluster.
    """

    kind: ClassVar[str] = "ray"
    options_model = RayOptions
    options: RayOptions
    library: ClassVar[str] = "ray"
    cluster: ClassVar[str] = "swarmwright.servers.launchers._ray_cluster"

    def address(self) -> str | None:
        """Return the address, or None if Ray finds the cluster."""
        address = self.options.address or os.environ.get("RAY_ADDRESS", "auto")
        return None if address == "auto" else address
