"""The registry of launchers, and their common options."""

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field, model_validator

from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError
from swarmwright.common.registry import Registry

if TYPE_CHECKING:
    from swarmwright.servers.launchers import Launcher


class LauncherOptions(Options):
    """Options of all launchers."""

    launcher: str
    count: int = Field(default=1, ge=1, le=10_000)
    """Number of servers."""
    min: int | None = Field(default=None, ge=1, le=10_000)
    """With `max`, instead of `count`: minimum number of servers. Default: 1."""
    max: int | None = Field(default=None, ge=1, le=10_000)
    """Maximum number of servers of an elastic pool, which has one per minute of remaining work, up to the
    evaluations of a generation."""
    idle: float = Field(default=60.0, ge=1, le=86_400)
    """Seconds after which idle servers of an elastic pool are ended."""
    cost_per_hour: float | None = Field(default=None, ge=0)
    """Cost per server and hour, in any currency; the total is reported at the end of the run."""
    budget: float | None = Field(default=None, gt=0)
    """Maximum cost of this launcher's servers in the whole run, including resumptions; needs `cost_per_hour`.
    When it is spent, the servers end; without others, the run is interrupted and can be resumed.
    """
    broker_host: str | None = Field(default=None, min_length=1)
    """Name or address of this machine for servers on the embedded broker; except on loopback, it listens on
    all interfaces, with TLS and passwords. Default for remote servers: the address of the default route.
    """
    broker_port: int | None = Field(default=None, ge=1, le=65535)
    """Port of the embedded broker. Default: any free port."""
    credentials: str | None = Field(default=None, min_length=1)
    """For an external broker: file with the servers' account, such as server.env of `swarmwright broker
    --init`. Default: the account of this process.
    """
    code: str | None = Field(default=None, min_length=1)
    """Folder on the servers' machines with the code of a custom simulation. Default: the code is copied."""
    files: list[str] = Field(default=[])
    """Further files to copy with the code: paths or patterns such as maps/*.json, relative to the folder of
    the simulation's file or package.
    """
    environment: dict[str, str] = Field(default={})
    """Further environment variables of the servers."""
    start_timeout: float = Field(default=120.0, gt=0, le=86_400)
    """Seconds until a running server must have reached the broker."""

    paths: ClassVar[tuple[str, ...]] = ("credentials",)
    """Options that are local paths, relative to the experiment's file."""

    @property
    def is_elastic(self) -> bool:
        """Whether the number of servers scales with the work."""
        return self.max is not None

    @property
    def initial_count(self) -> int:
        """Initial number of servers."""
        return (self.min or 1) if self.is_elastic else self.count

    @property
    def max_count(self) -> int:
        """Maximum number of servers."""
        return self.max if self.max is not None else self.count

    @model_validator(mode="after")
    def _check_consistency(self) -> "LauncherOptions":
        if self.min is not None and self.max is None:
            raise ValueError("min needs max, as the number of servers scales between the two")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise FieldError("min", f"{self.min} exceeds max: {self.max}")
        if self.max is not None and "count" in self.model_fields_set and self.count != 1:
            raise ValueError("give either count, or min and max")
        if self.budget is not None and not self.cost_per_hour:
            raise ValueError("budget needs cost_per_hour")
        return self


LAUNCHERS: "Registry[Launcher]" = Registry(
    "launcher",
    "swarmwright.launchers",
    {
        "dask": "swarmwright.servers.launchers.dask:Dask",
        "kubernetes": "swarmwright.servers.launchers.kubernetes:Kubernetes",
        "process": "swarmwright.servers.launchers.process:Process",
        "ray": "swarmwright.servers.launchers.ray:Ray",
        "slurm": "swarmwright.servers.launchers.slurm:Slurm",
        "ssh": "swarmwright.servers.launchers.ssh:Ssh",
    },
    "swarmwright.servers.launchers:Launcher",
)
"""All launchers, by the `launcher` of an entry of an experiment's `servers`."""
