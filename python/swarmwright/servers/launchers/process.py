"""Servers as supervised processes on this machine, restarted when they crash or hang."""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from swarmwright.common.errors import RunError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError, Specification
from swarmwright.servers.supervision import News, Output, ServerEvent, Supervisor
from swarmwright.servers.supervision.process import Limits

if TYPE_CHECKING:
    from swarmwright import _engine


_GRACE_S = 3600.0
"""Seconds for a process to finish its work before it is replaced."""
_WARNINGS = {"warning", "waiting", "lost"}
"""Events of servers that report problems."""
_KEPT_WARNINGS = 5
"""Warnings kept per server."""


class ProcessOptions(LauncherOptions):
    """Processes on this machine."""

    launcher: Literal["process"] = "process"
    recycle: int = Field(default=0, ge=0)
    """Evaluations after which a server's process is replaced, for simulations that leak memory; 0 for never.
    A batch counts as one. First replacements are staggered.
    """


class Process(Launcher):
    """Launcher of processes on this machine, restarted when they end or hang, as with `servers: 4`.

    Ends are reported to the pool, which attributes a crash to the evaluation that caused it.
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
        """Write the servers' files and start supervision."""
        self._folder = TemporaryFolder("servers")
        folder = self._folder.path
        for name, data in self.specification.files().items():
            (folder / name).touch(0o600)
            (folder / name).write_bytes(data)
        self._supervisor = Supervisor(
            [],
            output=self._output,
            tell=self._handle_news,
            limits=Limits(step=self.specification.step_timeout),
            environment=self.specification.child_variables(str(folder)),
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
        ended = {exit_.server: exit_.report for exit_ in self._supervisor.find_given_up()}
        return {
            server: Health("ended", ended[server]) if server in ended else Health("running")
            for server in self._supervisor.identifiers
        }

    def stop(self, servers: Sequence[int]) -> None:
        """End processes."""
        if self._supervisor is not None:
            self._supervisor.remove(servers)

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the last output lines of a process and its warnings."""
        if self._supervisor is None:
            return ()
        exits = [exit_ for exit_ in self._supervisor.find_given_up() if exit_.server == server]
        printed = exits[0].output_text.split("\n") if exits else self._supervisor.read_last_lines(server)
        return [*printed, *self._warnings.get(server, ())][-lines:]

    def log_to(self, file: Path) -> None:
        """Write the servers' output to a file."""
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
        """Raise LauncherError if supervision has failed, so that states are unknown."""
        if self._supervisor is not None:
            try:
                self._supervisor.check()
            except RunError as error:
                raise LauncherError(str(error)) from error

    def _handle_news(self, news: News) -> None:
        if isinstance(news, ServerEvent) and news.report.get("event") in _WARNINGS:
            words = news.report.get("message") or news.report.get("reason")
            warnings = self._warnings.setdefault(news.server, deque(maxlen=_KEPT_WARNINGS))
            if words and words not in warnings:
                warnings.append(str(words))

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
