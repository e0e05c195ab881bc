"""A launcher of a run: the servers that it has started, and what they have cost."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from swarmwright.common.formatting import amount
from swarmwright.servers.evaluation.launched.scaling import Scaling
from swarmwright.servers.launchers import Health, Launcher, LauncherError, LauncherOptions
from swarmwright.servers.server_use import ServerUse

SHORTEST_USE_S = 36.0
"""Seconds of servers below which their use is not reported where it has no price: 0.01 hours."""


@dataclass
class LaunchedServer:
    """One server that was started."""

    since: float
    """When it was started, or began to run (monotonic seconds)."""
    health: Health = field(default_factory=lambda: Health("waiting"))
    was_ready: bool = False
    """Whether it has been on the broker."""


@dataclass
class Entry:
    """A launcher, and the servers that it has started. Moments are monotonic seconds."""

    name: str
    launcher: Launcher
    options: LauncherOptions
    servers: dict[int, LaunchedServer] = field(default_factory=dict)
    """By their ids, those that have not ended."""
    wanted: int = 0
    """How many servers it is to have."""
    failures: int = 0
    """Servers in a row that ended without having been on the broker."""
    replace_at: float = 0.0
    """When servers that have ended are replaced at the earliest."""
    asked_at: float = 0.0
    """When it was last asked for its servers."""
    answered_at: float = field(default_factory=time.monotonic)
    """When it last answered, or had a server on the broker while it did not."""
    given_up: str | None = None
    """Why it is not used any more, None while it is."""
    scaling: Scaling | None = None
    """Follows the work; None for a fixed number of servers."""
    seconds: float = 0.0
    """Duration of all servers of this session together."""
    earlier: ServerUse = field(default_factory=ServerUse)
    """Use of servers in earlier sessions of the run."""
    counted_at: float = 0.0
    """Until when `seconds` are counted."""
    is_spent: bool = False
    """Whether the budget is spent."""
    reported_waiting: str = ""
    """What was last reported of servers that wait in a queue."""
    reported_starting: bool = False
    """Whether it was reported that servers run, of which none is on the broker yet."""
    ended_early: list[str] = field(default_factory=list)
    """How servers ended without having been on the broker, the last ones."""

    @property
    def use(self) -> ServerUse:
        """Of its servers in this session so far."""
        return ServerUse(self.seconds, self.seconds / 3600 * (self.options.cost_per_hour or 0.0))

    @property
    def is_counted(self) -> bool:
        """Whether its use is reported: of servers elsewhere, and of those that have a price."""
        return not self.launcher.is_here or self.options.cost_per_hour is not None

    @property
    def is_notable(self) -> bool:
        """Whether its use is more than a hundredth of an hour, or has a price."""
        seconds = (self.earlier + self.use).seconds
        return self.options.cost_per_hour is not None or seconds >= SHORTEST_USE_S

    @property
    def used(self) -> str:
        """What was used, in words."""

        def words(use: ServerUse) -> str:
            cost = "" if self.options.cost_per_hour is None else f", cost {amount(use.cost)}"
            return f"{amount(use.seconds / 3600)} server hours{cost}"

        whole = f" (the whole run: {words(self.earlier + self.use)})" if self.earlier.seconds else ""
        return f"{self.name} {words(self.use)}{whole}"

    def count_use(self, now: float) -> None:
        """Count the time of the servers that run; note when the budget is spent."""
        running = sum(server.health.state == "running" for server in self.servers.values())
        self.seconds += running * (now - self.counted_at)
        self.counted_at = now
        self.compare_with_budget()

    def compare_with_budget(self) -> None:
        """Note when the budget is spent, earlier sessions included."""
        budget, cost = self.options.budget, self.earlier.cost + self.use.cost
        self.is_spent = self.is_spent or (budget is not None and cost >= budget)

    @property
    def spent_before(self) -> str:
        """That earlier sessions of the run have spent the budget, in words."""
        return (
            f"the budget of {self.name}, {self.options.budget:g}, was spent in earlier sessions of this run, "
            f"which cost {amount(self.earlier.cost)}"
        )

    @contextmanager
    def named_errors(self) -> Iterator[None]:
        """Within this block, errors of the launcher begin with its name."""
        try:
            yield
        except LauncherError as error:
            raise LauncherError(f"{self.name}: {error}") from error
