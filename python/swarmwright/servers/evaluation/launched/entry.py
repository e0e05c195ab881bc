"""A launcher of a run, with its servers and their cost."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from swarmwright.common.formatting import format_amount
from swarmwright.servers.evaluation.launched.scaling import Scaling
from swarmwright.servers.launchers import Health, Launcher, LauncherError, LauncherOptions
from swarmwright.servers.server_use import ServerUse

SHORTEST_USE_S = 36.0
"""Use below which servers without a price are not reported: 0.01 hours."""


@dataclass
class LaunchedServer:
    """A started server."""

    since: float
    """When it was started or began to run, monotonic seconds."""
    health: Health = field(default_factory=lambda: Health("waiting"))
    was_ready: bool = False
    """Whether the server has been on the broker."""


@dataclass
class Entry:
    """A launcher and its servers. Times are monotonic seconds."""

    name: str
    launcher: Launcher
    options: LauncherOptions
    servers: dict[int, LaunchedServer] = field(default_factory=dict)
    """Running servers, by id."""
    target: int = 0
    """Intended number of servers."""
    failures: int = 0
    """Consecutive servers that ended before they reached the broker."""
    replace_at: float = 0.0
    """Earliest time to replace ended servers."""
    checked_at: float = 0.0
    """Time of the last health check."""
    answered_at: float = field(default_factory=time.monotonic)
    """Time when the launcher last answered or had a server on the broker."""
    failure: str | None = None
    """Why the launcher is no longer used; None while it is."""
    scaling: Scaling | None = None
    """Scaling with the work; None for a fixed number of servers."""
    seconds: float = 0.0
    """Total running time of all servers in this session."""
    earlier: ServerUse = field(default_factory=ServerUse)
    """Use of servers in earlier sessions of the run."""
    counted_at: float = 0.0
    """Time up to which `seconds` are counted."""
    is_spent: bool = False
    """Whether the budget is spent."""
    reported_waiting: str = ""
    """The last report about queued servers."""
    reported_starting: bool = False
    """Whether it was reported that no running server has reached the broker."""
    early_exits: list[str] = field(default_factory=list)
    """Messages of the last servers that ended before they reached the broker."""

    @property
    def use(self) -> ServerUse:
        """Use of its servers in this session so far."""
        return ServerUse(self.seconds, self.seconds / 3600 * (self.options.cost_per_hour or 0.0))

    @property
    def is_counted(self) -> bool:
        """Whether its use is reported: for remote servers and for servers with a price."""
        return not self.launcher.is_here or self.options.cost_per_hour is not None

    @property
    def is_notable(self) -> bool:
        """Whether its use exceeds 0.01 hours or has a price."""
        seconds = (self.earlier + self.use).seconds
        return self.options.cost_per_hour is not None or seconds >= SHORTEST_USE_S

    @property
    def usage_text(self) -> str:
        """Use of servers and their cost as text."""

        def format_use(use: ServerUse) -> str:
            cost = "" if self.options.cost_per_hour is None else f", cost {format_amount(use.cost)}"
            return f"{format_amount(use.seconds / 3600)} server hours{cost}"

        whole = f" (the whole run: {format_use(self.earlier + self.use)})" if self.earlier.seconds else ""
        return f"{self.name} {format_use(self.use)}{whole}"

    def count_use(self, now: float) -> None:
        """Count the time of running servers, and check the budget."""
        running = sum(server.health.state == "running" for server in self.servers.values())
        self.seconds += running * (now - self.counted_at)
        self.counted_at = now
        self.compare_with_budget()

    def compare_with_budget(self) -> None:
        """Check whether the budget is spent, including earlier sessions."""
        budget, cost = self.options.budget, self.earlier.cost + self.use.cost
        self.is_spent = self.is_spent or (budget is not None and cost >= budget)

    @property
    def budget_message(self) -> str:
        """Message that earlier sessions of the run have spent the budget."""
        return (
            f"the budget of {self.name}, {self.options.budget:g}, is spent: earlier sessions of this run "
            f"cost {format_amount(self.earlier.cost)}"
        )

    @contextmanager
    def prefix_errors(self) -> Iterator[None]:
        """Prefix errors of the launcher with its name within this block."""
        try:
            yield
        except LauncherError as error:
            raise LauncherError(f"{self.name}: {error}") from error
