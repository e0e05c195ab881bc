"""Servers as processes of this machine, which are watched, and started again when they crash or hang."""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from swarmwright.common.errors import RunError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError
from swarmwright.servers.launchers._specification import Specification
from swarmwright.servers.supervision import Event, News, Output, Supervisor
from swarmwright.servers.supervision.place import Limits

if TYPE_CHECKING:
    from swarmwright import _engine


_GRACE_S = 3600.0
"""Seconds for which a process that is to be replaced may finish what it computes."""
_WARNINGS = {"warning", "waiting", "lost"}
"""Events of servers that say what is wrong with them."""
_KEPT_WARNINGS = 5
"""Warnings that are kept of each server."""


class ProcessOptions(LauncherOptions):
    """Processes on this machine."""

    launcher: Literal["process"] = "process"
    recycle: int = Field(default=0, ge=0)
    """Evaluations after which a server's process is ended and another one started, for simulations that lose
    memory; 0 for never. The request, or the episode, under way is finished first. A batch of the mode batched
    counts as one. Replacements are staggered: of servers that start together, some are replaced earlier the
    first time."""


class Process(Launcher):
    """Server processes of this machine; those that end or hang are started again, as with `servers: 4`.

    The pool is told how processes end: a crash is attributed to the evaluation that caused it.
    """

    kind: ClassVar[str] = "process"
    options_model = ProcessOptions
    options: ProcessOptions
    is_here: ClassVar[bool] = True
    interval: ClassVar[float] = 0.2

    def __init__(self, options: ProcessOptions, specification: Specification) -> None:
        super().__init__(options, specification)
        self._output = Output()
        self._warnings: dict[int, deque[str]] = {}
        self._folder: TemporaryFolder | None = None
        self._supervisor: Supervisor | None = None

    def open(self) -> None:
        """Write the files that servers read, and begin to watch."""
        self._folder = TemporaryFolder("servers")
        here = self._folder.path
        for name, data in self.specification.files().items():
            (here / name).touch(0o600)
            (here / name).write_bytes(data)
        self._supervisor = Supervisor(
            [],
            output=self._output,
            tell=self._hear,
            limits=Limits(step=self.specification.step_timeout),
            environment=self.specification.child_variables(str(here)),
            recycle=self.options.recycle,
        )
        self._supervisor.start()

    def start(self, servers: Sequence[int]) -> None:
        """Start processes."""
        assert self._supervisor is not None
        self._check()
        try:
            self._supervisor.add([self._settings(server) for server in servers])
        except OSError as error:
            raise LauncherError(f"a process cannot be started: {error}") from error

    def health(self) -> Mapping[int, Health]:
        """Return the states of the processes."""
        assert self._supervisor is not None
        self._check()
        ended = {exit_.server: exit_.report for exit_ in self._supervisor.given_up()}
        return {
            server: Health("ended", ended[server]) if server in ended else Health("running")
            for server in self._supervisor.identifiers
        }

    def stop(self, servers: Sequence[int]) -> None:
        """End processes."""
        if self._supervisor is not None:
            self._supervisor.remove(servers)

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the last lines of a process, and of what it reports, such as a refusal of its broker."""
        if self._supervisor is None:
            return ()
        found = [exit_ for exit_ in self._supervisor.given_up() if exit_.server == server]
        printed = found[0].words.split("\n") if found else self._supervisor.printed(server)
        return [*printed, *self._warnings.get(server, ())][-lines:]

    def log_to(self, file: Path) -> None:
        """Write what the servers print to a file."""
        self._output.log_to(file)

    def close(self) -> None:
        """End all processes."""
        if self._supervisor is not None:
            self._supervisor.stop()
            self._supervisor = None
        self._output.close()
        if self._folder is not None:
            self._folder.close()
            self._folder = None

    def attach(self, pool: "_engine.Pool | None", servers: Sequence[int]) -> None:
        """Report the ends of processes to a pool."""
        if self._supervisor is not None:
            self._supervisor.attach(None if pool is None else pool.watch(servers))

    def _check(self) -> None:
        """Raise LauncherError when processes are not watched any more: their states are not known then."""
        if self._supervisor is not None:
            try:
                self._supervisor.check()
            except RunError as error:
                raise LauncherError(str(error)) from error

    def _hear(self, news: News) -> None:
        if isinstance(news, Event) and news.report.get("event") in _WARNINGS:
            words = news.report.get("message") or news.report.get("reason")
            kept = self._warnings.setdefault(news.server, deque(maxlen=_KEPT_WARNINGS))
            if words and words not in kept:
                kept.append(str(words))

    def _settings(self, server: int) -> dict[str, Any]:
        specification = self.specification
        return {
            **({"grace": _GRACE_S} if self.options.recycle else {}),
            "simulation": specification.simulation,
            "files": dict(specification.sources),
            "modules": list(specification.modules),
            "broker": specification.broker,
            "id": server,
            "prefix": specification.prefix,
            "step_timeout": specification.step_timeout,
        }
