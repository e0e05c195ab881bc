"""A supervised server: its id, its current process, and the history of its processes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from swarmwright.servers.supervision.process import Process
from swarmwright.servers.supervision.progress import Sample
from swarmwright.servers.supervision.server_exit import ServerExit

if TYPE_CHECKING:
    from swarmwright.experiment.document import Timeouts

FIRST_PAUSE_S = 0.1
"""Seconds before a restart; doubled with each consecutive end without a finished evaluation."""
LONGEST_PAUSE_S = 5.0
LONGEST_PAUSE_AT_WORK_S = 1.0
"""The same for servers that ended during an evaluation, where the pool counts ends per candidate."""

MAX_STARTS = 5
"""Consecutive failed starts until a server is given up; twice as many idle ends."""


START_S = 30.0
"""Minimum of the time limit for a start, seconds."""


@dataclass(frozen=True)
class Limits:
    """Time limits of servers, seconds."""

    start: float = START_S
    """Until it is on the broker, including the imports of a simulation."""
    step: float | None = None
    """For a step of an offloaded evaluation; None for no limit."""
    episode: float | None = None
    """For an evaluation; None for no limit."""

    @classmethod
    def from_timeouts(cls, timeouts: "Timeouts") -> Self:
        """Return the limits of an experiment."""
        return cls(max(START_S, timeouts.discovery), timeouts.step, timeouts.episode)


@dataclass
class SupervisedServer:
    """A server's settings, its current process and its history."""

    settings: Mapping[str, Any]
    """Arguments of the server's process."""
    quota: int
    """Evaluations after which its process is replaced; 0 for never."""
    process: Process | None = None
    restart_at: float | None = None
    """When to restart it (monotonic seconds)."""
    was_ready: bool = False
    """Whether any of its processes has been ready."""
    failed_starts: int = 0
    """Consecutive starts that did not become ready."""
    fruitless: int = 0
    """Consecutive ends of idle processes without a finished evaluation."""
    ends: int = 0
    """Consecutive ends without a finished evaluation."""
    sample: Sample = field(default_factory=Sample)
    """Last progress of its process."""
    since: float = 0.0
    """When that sample first appeared (monotonic seconds)."""
    episode_since: float = 0.0
    """When its current episode first appeared (monotonic seconds)."""
    last: ServerExit | None = None
    """How its last process ended."""
    is_given_up: bool = False
    """Whether the server will not be restarted."""
    has_left: bool = False
    """Whether the server left for good because another server has its id."""

    def is_to_be_replaced(self, process: Process) -> bool:
        """Whether its process has reached its quota and must be replaced."""
        if not self.quota or process.recycled or process.hung is not None:
            return False
        return process.progress.read().ended >= self.quota

    def find_hang(self, process: Process, now: float, limits: Limits) -> str | None:
        """Return why its process hangs, or None."""
        if not process.ready:
            most = limits.start + float(self.settings.get("wait", 0.0))
            late = self.was_ready and now - process.started > most
            return f"did not start within {most:g} s" if late else None
        sample = process.progress.read()
        if sample != self.sample:
            if (sample.position, sample.ended) != (self.sample.position, self.sample.ended):
                self.episode_since = now
            self.sample, self.since = sample, now
        if not sample.candidates:
            return None
        if limits.step is not None and now - self.since > limits.step:
            return f"made no step for {limits.step:g} s"
        if (
            limits.episode is not None
            and sample.episode is not None
            and now - self.episode_since > limits.episode
        ):
            return f"was at one episode for {limits.episode:g} s"
        return None

    def compute_pause(self, process: Process, server_exit: ServerExit, sample: Sample) -> float | None:
        """Return the seconds before a restart after an end; None for no restart."""
        # A server that was never ready fails permanently, unless a user or a scheduler ended it.
        if self.has_left or not (self.was_ready or server_exit.is_external):
            return None
        self.failed_starts = 0 if process.ready else self.failed_starts + 1
        self.ends = 0 if sample.ended else self.ends + 1
        wasted = not sample.ended and not sample.is_at_work and not server_exit.is_external
        self.fruitless = self.fruitless + 1 if wasted else 0
        if self.failed_starts >= MAX_STARTS or self.fruitless >= 2 * MAX_STARTS:
            return None
        longest = LONGEST_PAUSE_AT_WORK_S if sample.is_at_work else LONGEST_PAUSE_S
        return min(FIRST_PAUSE_S * 2.0 ** max(self.ends - 1, 0), longest)


def stagger_quotas(servers: int, recycle: int) -> list[int]:
    """Return staggered quotas for the first processes of servers that start together.

    Servers share the work evenly, so with equal quotas all would restart at the same time.
    """
    return [-(-recycle * (index + 1) // servers) for index in range(servers)]
