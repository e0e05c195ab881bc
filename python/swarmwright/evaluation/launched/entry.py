"""A launcher of a run: the servers that it has started, and what they have cost."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from swarmwright.core.formatting import amount
from swarmwright.core.server_use import ServerUse
from swarmwright.evaluation.launched.scaling import Scaling
from swarmwright.launchers import Health, Launcher, LauncherError, LauncherOptions

SHORTEST_USE_S = 36.0
"""Seconds of servers below which their use is not reported where it has no price: 0.01 hours."""


@dataclass
class LaunchedServer:
    """One server that was started."""

    since: float
    """When it was started, or began to run."""
    health: Health = field(default_factory=lambda: Health("waiting"))
    was_ready: bool = False


@dataclass
class Entry:
    """A launcher, and the servers that it has started."""

    name: str
    launcher: Launcher
    options: LauncherOptions
    servers: dict[int, LaunchedServer] = field(default_factory=dict)
    wanted: int = 0
    failures: int = 0
    again_at: float = 0.0
    looked: float = 0.0
    answered: float = field(default_factory=time.monotonic)
    given_up: str | None = None
    scaling: Scaling | None = None
    seconds: float = 0.0
    """Of servers that ran in this session, all together."""
    earlier: ServerUse = field(default_factory=ServerUse)
    """In earlier sessions of the run."""
    counted: float = 0.0
    """Until when they are counted."""
    is_spent: bool = False
    told: str = ""
    is_told_starting: bool = False
    words: list[str] = field(default_factory=list)
    """How servers ended, without having been on the broker."""

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
        running = sum(one.health.state == "running" for one in self.servers.values())
        self.seconds += running * (now - self.counted)
        self.counted = now
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
