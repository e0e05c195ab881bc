"""Observers of a run on the command line: logs, metrics, warnings."""

import functools
import re
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli._log import Log, log_options
from swarmwright.cli._output import Output, complain
from swarmwright.common.formatting import kind_of
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright import Experiment, Generation, Run
    from swarmwright.runs.monitoring.prometheus import ServerMetrics, ToolMetrics
    from swarmwright.servers.evaluation.reports import Report


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


def observe_options(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """Add `--log FILE` with its level and size, and `--metrics HOST:PORT`.

    The command gets `observing`, an `ObserverOptions`. It also takes `--tensorboard` and `--mlflow`, if they
    are declared above.
    """
    metrics = click.option(
        "--metrics",
        type=_endpoint,
        metavar="[HOST:]PORT",
        help="Serve Prometheus metrics at http://HOST:PORT/metrics. Default host: 127.0.0.1.",
    )

    @functools.wraps(command)
    def with_observers(**options: Any) -> Any:  # noqa: ANN401 - the command's
        values = {
            field.name: options.pop(field.name) for field in fields(ObserverOptions) if field.name in options
        }
        return command(observing=ObserverOptions(**values), **options)

    return log_options(metrics(with_observers))


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
