"""The interface of launchers: what starts simulation servers, says how they are, and ends them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, model_validator

from swarmwright.common.errors import RunError
from swarmwright.common.options import Options
from swarmwright.launchers._specification import Specification

if TYPE_CHECKING:
    from swarmwright import _engine

State = Literal["waiting", "running", "ended"]


class LauncherError(RunError):
    """A launcher cannot do what was asked; the message holds the words of the system that it uses."""


@dataclass(frozen=True)
class Health:
    """The state of one server, as far as its launcher knows it.

    state: "waiting" (in a queue, or its start is under way), "running" (its program was started; whether it
    has reached the broker is seen there) or "ended". reason: the system's own words, why it waits or how it
    ended; empty where there are none.
    """

    state: State
    reason: str = ""


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
            raise ValueError(f"min: {self.min} is more than max: {self.max}")
        if self.max is not None and "count" in self.model_fields_set and self.count != 1:
            raise ValueError("give either count, or min and max")
        if self.budget is not None and not self.cost_per_hour:
            raise ValueError("budget needs cost_per_hour")
        return self


class Launcher(ABC):
    """Starts simulation servers, says how they are, and ends them.

    An object belongs to one entry of an experiment's `servers` for the time of one run. Servers are named by
    their ids, which are unique on the broker. A server is `swarmwright serve` with the arguments of
    `Specification.arguments`, the environment of `Specification.variables`, and the files of
    `Specification.files`. Methods are called by one thread at a time; none but `close` takes longer than
    `start_timeout`.

    Args:
        options: of the entry.
        specification: what is started.
    """

    kind: ClassVar[str]
    """Its name in experiments."""
    options_model: ClassVar[type[LauncherOptions]]
    """Its options; `launcher` is a Literal with the name as default."""
    is_here: ClassVar[bool] = False
    """Whether servers run on this machine, so that they reach a broker on its loopback address."""
    interval: ClassVar[float] = 1.0
    """Seconds between two calls of `health`."""

    def __init__(self, options: Any, specification: Specification) -> None:  # noqa: ANN401 - each has its own
        self.options = options
        self.specification = specification

    def open(self) -> None:  # noqa: B027 - most need nothing
        """Prepare and check what is needed: programs, connections, accounts.

        Raises:
            LauncherError: it cannot be used, with the system's own words.
        """

    @abstractmethod
    def start(self, servers: Sequence[int]) -> None:
        """Begin to start servers with these ids, which were not used before, and return without waiting.

        Raises:
            LauncherError: none of them could be started.
        """

    @abstractmethod
    def health(self) -> Mapping[int, Health]:
        """Return the state of each server that was started and not stopped.

        Raises:
            LauncherError: it is not known now; servers may still be running.
        """

    @abstractmethod
    def stop(self, servers: Sequence[int]) -> None:
        """End servers, in whatever state they are: running ones get SIGTERM first.

        Raises:
            LauncherError: some could not be ended.
        """

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:  # noqa: ARG002 - for those that have logs
        """Return the last lines that a server printed, as far as they are known; also after its end."""
        return ()

    def log_to(self, file: Path) -> None:  # noqa: B027 - most have their logs elsewhere
        """Write what servers print from now on to a file, which is made when there is something."""

    @abstractmethod
    def close(self) -> None:
        """End all servers and leave nothing behind: no process, no job, no file. May be called repeatedly."""

    def attach(self, pool: "_engine.Pool | None", servers: Sequence[int]) -> None:  # noqa: B027 - see below
        """Report the ends of processes to a pool, from its thread; None: to none any more.

        Only for launchers that watch processes on this machine. servers: all ids that may be used.
        """
