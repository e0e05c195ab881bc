"""Observers of commands: `--log FILE`, metrics, warnings."""

import datetime as dt
import json
import logging
import re
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

import click

from swarmwright.cli._options import Decorator, WholeNumber, combine_options, gather
from swarmwright.cli._output import Output, complain, replace_nonfinite
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import kind_of
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright import Experiment, Generation, Run
    from swarmwright.runs.monitoring.prometheus import ServerMetrics, ToolMetrics
    from swarmwright.servers.evaluation.reports import Report

LEVELS = ("debug", "info", "warning", "error")
_NAMES = {logging.WARNING: "warning", logging.ERROR: "error", logging.CRITICAL: "error"}


log_options = combine_options(
    click.option(
        "--log",
        type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
        help="Append events to FILE, one JSON object per line; - is standard error.",
    ),
    click.option(
        "--log-level",
        type=click.Choice(LEVELS),
        default="info",
        show_default=True,
        help="Lowest level to log.",
    ),
    click.option(
        "--log-size",
        type=WholeNumber(min=1, max=2**20),
        metavar="MIB",
        help="Rename the log to FILE.1 before it exceeds this size. Default: 64 for `broker`, else "
        "unlimited.",
    ),
)


class Log:
    """A log of events; as a context manager, it logs the error that ends the command.

    Args:
        file: path, `-` for standard error, None for no log.
        level: lowest level to write.
        size: MiB at which the file is moved to FILE.1; None for no limit.

    The engine writes the file, including its own events, mainly of the embedded broker.
    """

    def __init__(self, file: Path | None, level: str = "info", *, size: int | None = None) -> None:
        self._least = LEVELS.index(level)
        self._lock = threading.Lock()
        self._active = False
        self._stream: TextIO | None = None
        self._handler: logging.Handler | None = None
        if file is None:
            return
        from swarmwright import _engine

        dash = str(file) == "-"
        try:
            if not dash:
                file.open("a", encoding="utf-8").close()
            _engine.log_to(None if dash else str(file), level, None if size is None else size << 20)
        except OSError as error:
            raise InputError(f"--log {file}: {error.strerror or error}") from error
        self._active = True
        self._stream = sys.stderr if dash else None

    def __bool__(self) -> bool:
        return self._active

    def __enter__(self) -> Self:
        if self:
            self._handler = _Handler(self)
            logging.getLogger("swarmwright").addHandler(self._handler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            self.write("info", "interrupted")
        elif error is not None:
            self.write("error", "failed", message=str(error), kind=type(error).__name__)
        if self._handler is not None:
            logging.getLogger("swarmwright").removeHandler(self._handler)
        self._active = False

    def write(self, level: str, event: str, /, **fields: object) -> None:
        """Write a line, unless its level is too low; None values are left out."""
        if not self._active or LEVELS.index(level) < self._least:
            return
        moment = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        fields = {key: value for key, value in fields.items() if value is not None}
        line = {"time": moment, "level": level, "event": event, **fields}
        text = json.dumps(replace_nonfinite(line), default=str)
        if self._stream is None:
            from swarmwright import _engine

            _engine.log_line(text)
            return
        try:
            with self._lock:
                self._stream.write(text + "\n")
                self._stream.flush()
        except OSError:
            self._active = False  # a closed pipe does not end a run

    def report(self, report: "Report") -> None:
        """Write a pool's report, see `_engine.Pool.listen`."""
        fields = {key: value for key, value in report.items() if key != "event"}
        event = str(report["event"])
        match event:
            case "status":
                status = fields["status"]
                keys = ("run", "generation", "done", "total", "no_server")
                waits = status["waiting_for"][:1]
                self.write("debug", event, **{key: status.get(key) for key in keys}, waiting_for=waits)
            case "server":
                state = fields.pop("state")
                self.write("warning" if state == "lost" else "info", f"server_{state}", **fields)
            case "attempt" if fields["outcome"] == "done":
                self.write("debug", event, **fields)
            case "attempt" if fields["outcome"] in {"overtaken", "dropped"}:
                self.write("debug", "attempt_overtaken", **fields)
            case "attempt":
                self.write("warning", "attempt_failed", **fields)
            case "broker_back":
                self.write("info", event, **fields)
            case _:
                self.write("warning", event, **fields)


class _Handler(logging.Handler):
    """Warnings of the library."""

    def __init__(self, log: Log) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        self._log.write(_NAMES.get(record.levelno, "warning"), "warning", message=record.getMessage())


PAUSE_S = 10.0
"""Seconds until the first count of a kind of warning; each further pause is twice as long."""
_SERVER = re.compile(r"\bserver (\d+)")
NAMED = 10
"""Largest number of servers that a count names."""
_COUNT = re.compile(r"(\d+) more warnings? of the same kind: ")
"""Beginning of a line of the pool that counts repetitions."""


class Warnings:
    """Shows warnings on standard error: the first of each kind, then counts per server."""

    def __init__(self) -> None:
        self._kinds: dict[str, _Kind] = {}

    def report(self, report: "Report") -> None:
        """Show a warning reported by a pool, see `_engine.Pool.listen`."""
        match report["event"]:
            case "warning":
                self._warn(str(report["message"]))
            case "broker_lost":
                self._warn(f"lost the broker ({report['reason']}); trying again")
            case "broker_back":
                self._warn("the broker is back")

    def _warn(self, text: str) -> None:
        counted = _COUNT.match(text)
        message, more = (text[counted.end() :], int(counted[1])) if counted else (text, 1)
        kind = self._kinds.get(kind_of(message))
        if kind is None:
            self._kinds[kind_of(message)] = _Kind(message)
            _show(text)
            return
        kind.add(message, more)
        if time.monotonic() - kind.shown_at >= kind.pause:
            kind.count()

    def close(self) -> None:
        """Print the counts that have not been printed."""
        for kind in self._kinds.values():
            kind.count()


class _Kind:
    """Repetitions of a message since the last count, per first server in the message."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.pause = PAUSE_S
        self.shown_at = time.monotonic()
        self._more = 0
        self._servers: Counter[int] = Counter()

    def add(self, text: str, more: int) -> None:
        self._more += more
        server = _SERVER.search(text)
        if server is not None:
            self._servers[int(server[1])] += more

    def count(self) -> None:
        if self._more:
            servers = [f"server {server}: {count}" for server, count in sorted(self._servers.items())]
            named = ", ".join(servers[:NAMED]) + ", ..." * (len(servers) > NAMED)
            text = _SERVER.sub("a server", self.text) if servers else self.text
            warnings = "warning" if self._more == 1 else "warnings"
            named = f" ({named})" if servers else ""
            _show(f"{self._more} more {warnings} of the same kind{named}: {text}")
            self.pause *= 2
        self._more, self.shown_at = 0, time.monotonic()
        self._servers.clear()


def _show(text: str) -> None:
    complain(escape_line(text))


def _endpoint(value: str) -> tuple[str, int]:
    """Parse HOST:PORT, or PORT on the loopback address."""
    host, _, port = value.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") or "127.0.0.1"
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise click.BadParameter(f"'{value}' is not an address: give HOST:PORT, or a PORT from 0 to 65535.")
    return host, int(port)


@dataclass(frozen=True)
class ObserverOptions:
    """Where a command reports progress besides its output."""

    log: Path | None = None
    log_level: str = "info"
    log_size: int | None = None
    metrics: tuple[str, int] | None = None
    tensorboard: Path | None = None
    mlflow: str | None = None


def _observe(*options: Decorator) -> Decorator:
    """Return options that say where progress is reported, of which commands get `observing`."""
    return gather(
        lambda **values: {"observing": ObserverOptions(**values)},
        *options,
        log_options,
        click.option(
            "--metrics",
            type=_endpoint,
            metavar="[HOST:]PORT",
            help="Serve Prometheus metrics at http://HOST:PORT/metrics. Default host: 127.0.0.1.",
        ),
    )


_tensorboard = click.option(
    "--tensorboard",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write the statistics of each generation for TensorBoard to this folder, of a sweep to a subfolder "
    "per run.",
)
observe_options = _observe()
"""`--log FILE`, its level and size, and `--metrics`; the command gets `observing`, an `ObserverOptions`."""
observe_sweep_options = _observe(_tensorboard)
"""The same, and `--tensorboard DIR`."""
observe_run_options = _observe(
    _tensorboard,
    click.option(
        "--mlflow",
        metavar="URI",
        help="Log to a new run of this MLflow tracking server (http://..) or database (sqlite:///..).",
    ),
)
"""The same, and `--mlflow URI`."""


class ToolObserver:
    """Writes the progress of an optimization to the log and the metrics."""

    def __init__(self, log: Log, figures: "ToolMetrics | None") -> None:
        self.log = log
        self._figures = figures

    def log_start(self, experiment: "Experiment") -> None:
        """Log that a run begins or continues."""
        self.log.write(
            "info",
            "run_started",
            simulation=experiment.label,
            method=experiment.to_mapping()["method"]["kind"],
            seed=experiment.seed,
            generations=experiment.budget.generations,
        )

    def log_generation(self, generation: "Generation") -> None:
        """Log an evaluated generation."""
        if self._figures is not None:
            self._figures.generation(generation)
        values = {field.name: getattr(generation, field.name) for field in fields(generation)}
        self.log.write("info", "generation", **{**values, "waiting_for": generation.waiting_for or None})

    def log_end(self, run: "Run") -> None:
        """Log the end of a run."""
        self.log.write(
            "info",
            "run_ended",
            run=str(run.path),
            state=run.state,
            evaluations=run.evaluations,
            best_fitness=run.best.fitness if run.generations else None,
            seconds=run.seconds,
        )


@contextmanager
def observe_run(output: Output, observing: ObserverOptions) -> Iterator[ToolObserver]:
    """Open the log and metrics of an optimization during a `with` block, and show its warnings."""
    from swarmwright.servers.evaluation.reports import listening

    with ExitStack() as stack:
        log = stack.enter_context(Log(observing.log, observing.log_level, size=observing.log_size))
        warnings = stack.enter_context(closing(Warnings()))
        stack.enter_context(listening(warnings.report, warnings_only=True))
        figures = None
        if log:
            stack.enter_context(listening(log.report))
        if observing.metrics is not None:
            from swarmwright.runs.monitoring.prometheus import ToolMetrics, serve_metrics

            figures = ToolMetrics()
            _announce_metrics(output, log, stack.enter_context(serve_metrics(figures, *observing.metrics)))
            stack.enter_context(listening(figures.report))
        yield ToolObserver(log, figures)


@contextmanager
def observe_servers(
    output: Output, observing: ObserverOptions
) -> "Iterator[tuple[Log, ServerMetrics | None]]":
    """Open the log and metrics of servers during a `with` block."""
    with ExitStack() as stack:
        log = stack.enter_context(Log(observing.log, observing.log_level, size=observing.log_size))
        figures = None
        if observing.metrics is not None:
            from swarmwright.runs.monitoring.prometheus import ServerMetrics, serve_metrics

            figures = ServerMetrics()
            _announce_metrics(output, log, stack.enter_context(serve_metrics(figures, *observing.metrics)))
        yield log, figures


def _announce_metrics(output: Output, log: Log, url: str) -> None:
    log.write("info", "metrics_offered", url=url)
    output.text(f"Metrics for Prometheus are at {url}")
