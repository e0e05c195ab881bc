"""Output of `optimize`, `resume`, `sweep` and `serve` for programs: a log, and metrics for Prometheus."""

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli._log import Log, log_options
from swarmwright.cli._output import Output
from swarmwright.cli._warnings import Warnings

if TYPE_CHECKING:
    from swarmwright import Experiment, Generation, Run
    from swarmwright.runs.monitoring.prometheus import ServeFigures, ToolFigures


class Endpoint(click.ParamType[tuple[str, int]]):
    """HOST:PORT, or PORT for this machine alone."""

    name = "endpoint"

    def convert(
        self, value: str | tuple[str, int], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        """Host and port."""
        if isinstance(value, tuple):
            return value
        host, _, port = value.rpartition(":")
        host = host.removeprefix("[").removesuffix("]") or "127.0.0.1"
        if not port.isascii() or not port.isdigit() or int(port) > 65535:
            self.fail(f"'{value}' is not an address: give HOST:PORT, or a PORT from 0 to 65535.", param, ctx)
        return host, int(port)


def observe_options(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """`--log FILE` with its level and size, and `--metrics HOST:PORT`."""
    metrics = click.option(
        "--metrics",
        type=Endpoint(),
        metavar="[HOST:]PORT",
        help="Expose Prometheus metrics at http://HOST:PORT/metrics. Default of HOST: 127.0.0.1.",
    )
    return log_options(metrics(command))


@dataclass(frozen=True)
class Observing:
    """What is wanted."""

    log: Path | None = None
    log_level: str = "info"
    metrics: tuple[str, int] | None = None
    log_size: int | None = None


class ToolObserver:
    """Receives the progress of an optimization."""

    def __init__(self, log: Log, figures: "ToolFigures | None") -> None:
        self.log = log
        self._figures = figures

    def started(self, experiment: "Experiment") -> None:
        """A run begins, or goes on."""
        self.log.write(
            "info",
            "run_started",
            simulation=experiment.label,
            method=experiment.to_mapping()["method"]["kind"],
            seed=experiment.seed,
            generations=experiment.budget.generations,
        )

    def generation(self, generation: "Generation") -> None:
        """A generation has been evaluated."""
        if self._figures is not None:
            self._figures.generation(generation)
        values = {field.name: getattr(generation, field.name) for field in fields(generation)}
        self.log.write("info", "generation", **{**values, "waiting_for": generation.waiting_for or None})

    def ended(self, run: "Run") -> None:
        """A run has ended."""
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
def observed(output: Output, wanted: Observing) -> Iterator[ToolObserver]:
    """Open what is wanted of an optimization tool for the time of a `with` block, and show its warnings."""
    from swarmwright.servers.evaluation.reports import listening

    with ExitStack() as stack:
        log = stack.enter_context(Log(wanted.log, wanted.log_level, size=wanted.log_size))
        warnings = stack.enter_context(closing(Warnings()))
        stack.enter_context(listening(warnings.report, warnings_only=True))
        figures = None
        if log:
            stack.enter_context(listening(log.report))
        if wanted.metrics is not None:
            from swarmwright.runs.monitoring.prometheus import ToolFigures, offered

            figures = ToolFigures()
            _say(output, log, stack.enter_context(offered(figures, *wanted.metrics)))
            stack.enter_context(listening(figures.report))
        yield ToolObserver(log, figures)


@contextmanager
def observed_servers(output: Output, wanted: Observing) -> "Iterator[tuple[Log, ServeFigures | None]]":
    """Open what is wanted of servers, for the time of a `with` block."""
    with ExitStack() as stack:
        log = stack.enter_context(Log(wanted.log, wanted.log_level, size=wanted.log_size))
        figures = None
        if wanted.metrics is not None:
            from swarmwright.runs.monitoring.prometheus import ServeFigures, offered

            figures = ServeFigures()
            _say(output, log, stack.enter_context(offered(figures, *wanted.metrics)))
        yield log, figures


def _say(output: Output, log: Log, url: str) -> None:
    log.write("info", "metrics_offered", url=url)
    output.text(f"Metrics for Prometheus are at {url}")
