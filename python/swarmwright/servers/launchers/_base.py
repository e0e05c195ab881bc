"""The interface of launchers, which start, check and end simulation servers."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from swarmwright.common.errors import RunError
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._specification import Specification

if TYPE_CHECKING:
    from swarmwright import _engine

State = Literal["waiting", "running", "ended"]


class LauncherError(RunError):
    """A launcher failed; the message quotes the system behind it."""


@dataclass(frozen=True)
class Health:
    """The state of one server, as known to its launcher."""

    state: State
    """"waiting" (queued or starting), "running" (its program was started) or "ended"."""
    reason: str = ""
    """The system's message, why the server waits or how it ended; may be empty."""


class Launcher(ABC):
    """Base class of launchers, which start, check and end simulation servers.

    An object belongs to one entry of an experiment's `servers` for the duration of a run. Servers are
    identified by ids that are unique on the broker. A server is `swarmwright serve` with
    `Specification.arguments`, `Specification.variables` as environment, and `Specification.files`. Methods
    are called by one thread at a time; none except `close` may take longer than `start_timeout`.

    Args:
        options: options of the entry.
        specification: specification of the servers.
    """

    kind: ClassVar[str]
    """Name of the launcher in experiments."""
    options_model: ClassVar[type[LauncherOptions]]
    """Model of its options; `launcher` is a Literal with the name as default."""
    is_here: ClassVar[bool] = False
    """Whether servers run on this machine and can use a broker on its loopback address."""
    interval: ClassVar[float] = 1.0
    """Seconds between two calls of `health`."""

    def __init__(self, options: Any, specification: Specification) -> None:  # noqa: ANN401 - each has its own
        self.options = options
        self.specification = specification

    def open(self) -> None:  # noqa: B027 - most need nothing
        """Prepare and check what is needed: programs, connections, accounts.

        Raises:
            LauncherError: the launcher cannot be used; with the system's message.
        """

    @abstractmethod
    def start(self, servers: Sequence[int]) -> None:
        """Begin to start servers with these new ids, and return without waiting.

        Raises:
            LauncherError: none of them could be started.
        """

    @abstractmethod
    def health(self) -> Mapping[int, Health]:
        """Return the state of each started server that was not stopped.

        Raises:
            LauncherError: the states are unknown at present; servers may still be running.
        """

    @abstractmethod
    def stop(self, servers: Sequence[int]) -> None:
        """End servers in any state; running ones get SIGTERM first.

        Raises:
            LauncherError: some could not be ended.
        """

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:  # noqa: ARG002 - for those that have logs
        """Return the last known output lines of a server, also after its end."""
        return ()

    def log_to(self, file: Path) -> None:  # noqa: B027 - most have their logs elsewhere
        """Write further output of servers to a file, created with the first line."""

    @abstractmethod
    def close(self) -> None:
        """End all servers and remove all processes, jobs and files. May be called repeatedly."""

    def attach(self, pool: "_engine.Pool | None", servers: Sequence[int]) -> None:  # noqa: B027 - see below
        """Report the ends of processes to a pool, on its thread; None to stop.

        Only for launchers that watch processes on this machine. servers: all ids that may be used.
        """
