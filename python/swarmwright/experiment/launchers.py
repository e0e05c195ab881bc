"""Which launchers there are, and the options that all of them have."""

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
    """Servers to start."""
    min: int | None = Field(default=None, ge=1, le=10_000)
    """With `max`, instead of `count`: the fewest servers. Default: 1."""
    max: int | None = Field(default=None, ge=1, le=10_000)
    """The most servers of an elastic pool. There is one for each minute of work that is left of the run, as
    measured by the evaluations so far, but not more than a generation has evaluations."""
    idle: float = Field(default=60.0, ge=1, le=86_400)
    """Seconds after which servers of an elastic pool are ended that were not needed in this time."""
    cost_per_hour: float | None = Field(default=None, ge=0)
    """Cost of a server for an hour, in any currency. What was spent is reported at the end of the run."""
    budget: float | None = Field(default=None, gt=0)
    """Most that this launcher's servers may cost in the whole run, also when it is resumed; needs
    `cost_per_hour`. When it is spent they are ended; without other servers the run is interrupted, its
    results kept, and `resume` goes on with a larger budget or other servers."""
    broker_host: str | None = Field(default=None, min_length=1)
    """Name or address by which the servers reach this machine, for the embedded broker. Default for servers
    elsewhere: the address of this machine's default route. If it is not a loopback address, the broker
    listens on all interfaces, with TLS and an account for each launcher."""
    broker_port: int | None = Field(default=None, ge=1, le=65535)
    """Port of the embedded broker, where a firewall admits a certain one. Default: any free port."""
    credentials: str | None = Field(default=None, min_length=1)
    """For an external broker: a file with the variables of the servers' account, such as the server.env that
    `swarmwright broker --init` writes. Default: the account that the optimization tool itself uses."""
    code: str | None = Field(default=None, min_length=1)
    """Folder on the servers' machines that holds the code of a custom simulation. Default: the code is
    packed and copied there."""
    files: list[str] = Field(default=[])
    """Further files that the simulation reads, copied with its code, and kept with the run: paths or patterns
    such as maps/*.json, relative to the folder of its file; of a class in a package, `pkg.world:World`, to
    the folder that holds the package."""
    environment: dict[str, str] = Field(default={})
    """Further environment variables of the servers."""
    start_timeout: float = Field(default=120.0, gt=0, le=86_400)
    """Seconds that a server which runs may take until it is on the broker."""

    paths: ClassVar[tuple[str, ...]] = ("credentials",)
    """Options that are paths on this machine; they are relative to the experiment's file."""

    @property
    def is_elastic(self) -> bool:
        """Whether the number of servers follows the work."""
        return self.max is not None

    @property
    def fewest(self) -> int:
        """How many servers are started at first."""
        return (self.min or 1) if self.is_elastic else self.count

    @property
    def most(self) -> int:
        """How many servers there are at most."""
        return self.max if self.max is not None else self.count

    @model_validator(mode="after")
    def _consistent(self) -> "LauncherOptions":
        if self.min is not None and self.max is None:
            raise ValueError("min needs max: the number of servers follows the work between the two")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise FieldError("min", f"{self.min} is more than max: {self.max}")
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
