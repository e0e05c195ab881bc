"""Servers as tasks on the workers of a Dask cluster (https://distributed.dask.org)."""

import os
from typing import ClassVar, Literal

from pydantic import Field

from swarmwright.common.errors import InputError
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._driven import DrivenLauncher


class DaskOptions(LauncherOptions):
    """Workers of an existing Dask cluster, including dask-jobqueue and dask-kubernetes."""

    launcher: Literal["dask"] = "dask"
    address: str | None = Field(default=None, min_length=1)
    """Address of the scheduler (`client.scheduler.address`), such as tcp://head:8786. Default: the
    environment variable DASK_SCHEDULER_ADDRESS."""
    scheduler_file: str | None = Field(default=None, min_length=1)
    """File written by `dask scheduler --scheduler-file`, instead of an address."""
    resources: dict[str, float] = Field(default={})
    """Worker resources per server, such as {simulator: 1}; see `dask worker --resources`."""

    paths: ClassVar[tuple[str, ...]] = (*LauncherOptions.paths, "scheduler_file")


class Dask(DrivenLauncher):
    """Launcher of servers on a Dask cluster, one task each, which occupies a thread of a worker.

    A task runs `swarmwright serve` as a child process of its worker.
    """

    kind: ClassVar[str] = "dask"
    options_model = DaskOptions
    options: DaskOptions
    library: ClassVar[str] = "distributed"
    cluster: ClassVar[str] = "swarmwright.servers.launchers._dask_cluster"

    def open(self) -> None:
        """Connect to the cluster; see `DrivenLauncher.open`."""
        if self.options.scheduler_file is None and self.address() is None:
            raise InputError(
                "servers.address: is missing; dask needs the address of a scheduler, such as "
                "tcp://head:8786, or a scheduler_file"
            )
        super().open()

    def address(self) -> str | None:
        """Return the address of the scheduler; None if it is in a scheduler file."""
        if self.options.scheduler_file is not None:
            return None
        return self.options.address or os.environ.get("DASK_SCHEDULER_ADDRESS")
