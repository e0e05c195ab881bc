"""A server that is kept alive: its id, the process that has it now, and how its processes have fared."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from swarmwright.servers.supervision.process import Process
from swarmwright.servers.supervision.progress import Sample
from swarmwright.servers.supervision.server_exit import ServerExit

if TYPE_CHECKING:
    from swarmwright.experiment.document import Timeouts

FIRST_PAUSE_S = 0.1
"""Seconds before a server is started again; doubled with each end in a row before which it did nothing."""
LONGEST_PAUSE_S = 5.0
LONGEST_PAUSE_AT_WORK_S = 1.0
"""For servers that ended while they evaluated: these ends are counted by candidate."""

MOST_STARTS = 5
"""Starts in a row that fail before a server is given up; also ends in a row at nothing, twice as many."""


START_S = 30.0
"""Seconds that a server has to start, at least."""


@dataclass(frozen=True)
class Limits:
    """Seconds that servers may take."""

    start: float = START_S
    """Until it is on the broker, which includes the imports of a simulation."""
    step: float | None = None
    """For a step of an offloaded evaluation; None for any time."""
    episode: float | None = None
    """For an evaluation; None for any time."""

    @classmethod
    def of(cls, timeouts: "Timeouts") -> Self:
        """Return those of an experiment."""
        return cls(max(START_S, timeouts.discovery), timeouts.step, timeouts.episode)


@dataclass
class Place:
    """A server's id, and the process that has it now."""

    settings: Mapping[str, Any]
    """Arguments of the server's process."""
    quota: int
    """Evaluations after which its process is replaced; 0 for never."""
    process: Process | None = None
    again_at: float | None = None
    """When it is to be started again."""
    was_ready: bool = False
    """Whether one of its processes was ready once."""
    failed_starts: int = 0
    """Starts in a row after which no process was ready."""
    fruitless: int = 0
    """Ends in a row at no evaluation, without any before."""
    ends: int = 0
    """Ends in a row without an evaluation before."""
    sample: Sample = field(default_factory=Sample)
    """Progress of its process when that was last read."""
    since: float = 0.0
    """When that sample was first seen to be there (monotonic seconds)."""
    episode_since: float = 0.0
    """When its present episode was first seen (monotonic seconds)."""
    last: ServerExit | None = None
    """How its last process ended."""
    given_up: bool = False
    """Whether it will not be started again."""
    left: bool = False
    """Whether it was ready and left by itself for a reason that lasts: another server has its id."""

    def is_to_be_replaced(self, process: Process) -> bool:
        """Whether its process has had its evaluations and is to be told so."""
        if not self.quota or process.recycled or process.hung is not None:
            return False
        return process.progress.read().ended >= self.quota

    def hangs(self, process: Process, now: float, limits: Limits) -> str | None:
        """Why its process is to be ended, if it is."""
        if not process.ready:
            most = limits.start + float(self.settings.get("wait", 0.0))
            late = self.was_ready and now - process.started > most
            return f"did not start within {most:g} s" if late else None
        sample = process.progress.read()
        if sample != self.sample:
            if (sample.place, sample.ended) != (self.sample.place, self.sample.ended):
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

    def pause(self, process: Process, server_exit: ServerExit, sample: Sample) -> float | None:
        """How long to wait before it is started again after an end; None: not at all."""
        # Never ready: the cause is permanent, unless a user or a scheduler has ended it.
        if self.left or not (self.was_ready or server_exit.outside):
            return None
        self.failed_starts = 0 if process.ready else self.failed_starts + 1
        self.ends = 0 if sample.ended else self.ends + 1
        wasted = not sample.ended and not sample.is_at_work and not server_exit.outside
        self.fruitless = self.fruitless + 1 if wasted else 0
        if self.failed_starts >= MOST_STARTS or self.fruitless >= 2 * MOST_STARTS:
            return None
        longest = LONGEST_PAUSE_AT_WORK_S if sample.is_at_work else LONGEST_PAUSE_S
        return min(FIRST_PAUSE_S * 2.0 ** max(self.ends - 1, 0), longest)


def quotas(servers: int, recycle: int) -> list[int]:
    """Evaluations of the first processes of servers that start together, so that they do not end together.

    They share the work evenly, so that a run would stand still while all are started again.
    """
    return [-(-recycle * (index + 1) // servers) for index in range(servers)]
