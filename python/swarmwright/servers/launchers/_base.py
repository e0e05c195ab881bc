"""The interface of launchers: what starts simulation servers, says how they are, and ends them."""

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
