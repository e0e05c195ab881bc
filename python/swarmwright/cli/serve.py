"""`swarmwright serve`: simulation servers."""

import json
import queue
import secrets
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._observing import Log, ObserverOptions, observe_options, observe_servers
from swarmwright.cli._output import Output, complain, print_note
from swarmwright.cli._signals import Terminated
from swarmwright.experiment.broker_address import DEFAULT_BROKER
from swarmwright.servers.broker.credentials import prepare
from swarmwright.servers.supervision import News, ServerEnd, ServerEvent, ServerRestart, Supervisor
from swarmwright.servers.supervision import Output as Printed

if TYPE_CHECKING:
    from swarmwright.runs.monitoring.prometheus import ServerMetrics

LARGEST_RANDOM_ID = 2**31 - 1
"""Random ids are short, because people read and type them."""


@click.command(
    "serve",
    cls=Command,
    example="swarmwright serve minisim --count 4\nswarmwright serve gather.py:Gather --broker mqtt://localhost:1883\n"
    "swarmwright serve arena --modules spiral_modules.py:Spiral,spiral_modules.py:Elapsed",
)
@click.argument("simulation")
@options.broker_option(default=DEFAULT_BROKER, text="Address of the broker.")
@click.option(
    "--id",
    "first",
    type=options.WholeNumber(0, options.LARGEST_ID),
    help="Id of the first server; the others count up. Default: random.",
)
@click.option(
    "--count", type=options.WholeNumber(1, 1024), default=1, show_default=True, help="Number of servers."
)
@options.prefix_option
@click.option(
    "--step-timeout",
    type=options.Seconds(0.1, 86400.0),
    default=60.0,
    show_default=True,
    help="Time an episode waits for an agent's actuators before it is aborted.",
)
@click.option(
    "--restart/--no-restart",
    default=True,
    help="Restart servers that crash or are killed. Turn it off if a service manager such as systemd or "
    "Slurm does it.  [default: restart]",
)
@options.wait_option
@click.option(
    "--broker-timeout",
    type=options.Seconds(1.0, 31 * 86400.0),
    help="Exit when the broker has been unreachable for this long. Default: keep trying.",
)
@click.option(
    "--grace",
    type=options.Seconds(0.0, 86400.0),
    default=3.0,
    show_default=True,
    help="Time after SIGTERM to finish the current request or episode; a second signal exits at once.",
)
@click.option(
    "--modules",
    multiple=True,
    metavar="MODULE,..",
    help="Behaviours and conditions in Python to offer, as path/to/file.py:Class or by their installed "
    "names. Without them, machines that use Python modules are not evaluated. Repeatable.",
)
@observe_options
@options.trust_option
@options.json_option
def command(
    simulation: str,
    broker: str,
    first: int | None,
    count: int,
    prefix: str,
    step_timeout: float,
    restart: bool,
    wait: float | None,
    broker_timeout: float | None,
    grace: float,
    modules: tuple[str, ...],
    observing: ObserverOptions,
    output: Output,
) -> int:
    """Start simulation servers.

    SIMULATION is the title of a built-in simulation (minisim); a subclass of swarmwright.Simulation
    (file.py:Class or package.module:Class); an environment of another library (gymnasium:CartPole-v1,
    pettingzoo:mpe2.simple_spread_v3?N=5); or an experiment file, whose simulation is served, for example a
    command.

    Each server is a process that serves one optimization tool at a time, until Ctrl-C.
    """
    simulation = _resolve_simulation(simulation)
    title = _title(simulation)
    names = [name.strip() for text in modules for name in text.split(",")]
    title += _modules_in_words(names)
    if first is None:
        first = 1 + secrets.randbelow(LARGEST_RANDOM_ID - count + 1)
    elif first + count - 1 > options.LARGEST_ID:
        raise click.UsageError(
            f"--id {first} with --count {count} passes the largest id, {options.LARGEST_ID}."
        )
    shared = {
        "simulation": simulation,
        "modules": names,
        "broker": broker,
        "prefix": prefix,
        "step_timeout": step_timeout,
        "wait": wait or 0.0,
        "grace": grace,
    }
    settings = [{**shared, "id": first + i} for i in range(count)]
    prepare(broker)
    with observe_servers(output, observing) as (lines, figures):
        reporter = Reporter(output, title, broker, lines, figures)
        with suppress(KeyboardInterrupt):  # Ctrl-C and SIGTERM are the normal end
            _serve(settings, reporter, restart=restart, patience=broker_timeout, grace=grace)
    return reporter.status


def _serve(
    settings: Sequence[Mapping[str, Any]],
    reporter: "Reporter",
    *,
    restart: bool,
    patience: float | None,
    grace: float,
) -> None:
    """Keep servers alive until none is left.

    patience: seconds without the broker after which the servers end. grace: seconds after SIGTERM to finish
    current work.
    """
    news: queue.SimpleQueue[News] = queue.SimpleQueue()
    servers = Supervisor(settings, draws=True, restart=restart, output=Printed(), tell=news.put)
    reached = time.monotonic()
    connected: set[int] = set()
    try:
        servers.start()
        while not (servers.has_given_up_all() and news.empty()):
            # A time-out, because a wait without one cannot be interrupted on every system.
            with suppress(queue.Empty):
                item = news.get(timeout=1.0)
                reporter.tell(item)
                _note_connection(item, connected)
            servers.check()
            if connected:
                reached = time.monotonic()
            elif patience is not None and time.monotonic() - reached > patience:
                reporter.give_up(f"the broker has been unreachable for {patience:g} s")
                return
    except Terminated:
        servers.stop(grace)
        raise
    finally:
        servers.stop()


def _note_connection(item: News, connected: set[int]) -> None:
    """Update the set of servers that are connected to the broker."""
    if isinstance(item, ServerEnd):
        connected.discard(item.server_exit.server)
    elif isinstance(item, ServerEvent) and item.report.get("event") in {"ready", "busy"}:
        connected.add(item.server)
    elif isinstance(item, ServerEvent) and item.report.get("event") == "lost":
        connected.discard(item.server)


def _resolve_simulation(simulation: str) -> str:
    """Return the name of the simulation, for an experiment file that of the experiment."""
    if Path(simulation).suffix not in {".yaml", ".yml"}:
        return simulation
    from swarmwright.common.errors import InputError
    from swarmwright.common.simulation_names import is_command
    from swarmwright.experiment.commands import find_missing
    from swarmwright.experiment.derived import place_of
    from swarmwright.experiment.experiment import Experiment

    experiment = Experiment.load(simulation)
    problem = find_missing(experiment.simulation) if is_command(experiment.simulation) else None
    if problem is not None:
        raise InputError(f"{place_of(experiment, 'simulation')}{problem}")
    return experiment.simulation


def _title(simulation: str) -> str:
    """Return the title of the simulation; errors are reported before any server is started."""
    from swarmwright.common.simulation_names import is_python
    from swarmwright.simulations import catalogue

    if is_python(simulation):
        return catalogue.title(simulation)
    if simulation.endswith(".py"):
        from swarmwright.simulations.near_names import describe_missing_class

        raise click.UsageError(describe_missing_class(simulation))
    if simulation not in catalogue.titles():
        from swarmwright.simulations.near_names import describe_unknown_simulation

        raise click.UsageError(
            f"{describe_unknown_simulation(simulation)}; a class in Python is named like file.py:Class"
        )
    return simulation


def _modules_in_words(modules: Sequence[str]) -> str:
    """Describe the offered modules; errors are reported before any server is started."""
    if not modules:
        return ""
    from swarmwright.servers.evaluation.module_code import import_modules

    return f" with {', '.join(dict.fromkeys(name for _, name in import_modules(modules)))}"


class Reporter:
    """Reports the events of servers to a person or a script.

    status: the exit status so far.
    """

    def __init__(
        self,
        output: Output,
        simulation: str,
        broker: str,
        log: Log | None = None,
        figures: "ServerMetrics | None" = None,
    ) -> None:
        self.status = 0
        self._output = output
        self._log = Log(None) if log is None else log
        self._figures = figures
        self._offer = f"{simulation} on {broker}"
        self._last: dict[int, str] = {}
        self._errors: dict[int, str] = {}

    def tell(self, item: News) -> None:
        """Report one piece of news."""
        self._note(item)
        if isinstance(item, ServerEnd):
            self._report_end(item)
            return
        if isinstance(item, ServerRestart):
            self._output.json({"event": "restarted", "server": item.server, "pid": item.pid})
            self._output.text(f"server {item.server} was restarted (process {item.pid})")
            return
        if item.report.get("event") == "error":
            self._errors[item.server] = str(item.report.get("message"))
            return
        self._output.json({"server": item.server, "pid": item.pid, **item.report})
        if item.report.get("event") == "failure":
            self._output.text(f"server {item.server}: {item.report['message']}")
            self._output.block(str(item.report["traceback"]), indent="  ")
            return
        line = self._sentence(item.server, item.pid, item.report)
        if line != self._last.get(item.server):
            self._output.text(line)
            self._last[item.server] = line

    def give_up(self, reason: str) -> None:
        """Report the reason why all servers end."""
        self.status = 1
        self._output.json({"event": "gave_up", "message": reason})
        self._log.write("error", "gave_up", message=reason)
        complain(reason)

    def _note(self, item: News) -> None:
        """Write an item to the log and the metrics."""
        if isinstance(item, ServerEnd):
            end = item.server_exit
            event, level, server, pid = "ended", "error" if end.status else "info", end.server, end.pid
            fields: dict[str, Any] = {"status": end.status, "message": end.output_text or None}
        elif isinstance(item, ServerRestart):
            event, level, server, pid, fields = "restarted", "warning", item.server, item.pid, {}
        else:
            server, pid = item.server, item.pid
            event = str(item.report.get("event"))
            level = {"ready": "info", "busy": "info", "error": "error"}.get(event, "warning")
            fields = {key: value for key, value in item.report.items() if key not in {"event", "server"}}
        self._log.write(level, f"server_{event}", server=server, pid=pid, **fields)
        if self._figures is not None:
            self._figures.event(server, event)

    def _sentence(self, server: int, pid: int, report: Mapping[str, Any]) -> str:
        event = report.get("event")
        detail = report.get("message") or report.get("reason") or ""
        if event == "ready":
            return f"server {server} (process {pid}) is ready: {self._offer}"
        if event == "busy":
            return f"server {server} is busy for {report.get('tool') or 'an optimization tool'}"
        if event == "lost":
            return f"server {server} has lost the broker{': ' if detail else ''}{detail}"
        rest = detail or json.dumps({key: value for key, value in report.items() if key != "event"})
        return f"server {server}: {event}: {rest}"

    def _report_end(self, item: ServerEnd) -> None:
        server_exit = item.server_exit
        error = self._errors.pop(server_exit.server, None)
        self.status = max(self.status, 2 if server_exit.status == 2 and error else 1)
        self._output.json(
            {
                "event": "ended",
                "server": server_exit.server,
                "pid": server_exit.pid,
                "status": server_exit.status,
                "message": error or server_exit.output_text,
                "restart": item.pause,
            }
        )
        restart = "" if item.pause is None else f"; restarting in {item.pause:g} s"
        if error:
            complain(f"server {server_exit.server}: {error}{restart}")
            return
        complain(
            f"server {server_exit.server} (process {server_exit.pid}) {server_exit.description}{restart}"
        )
        if server_exit.output_text:
            print_note("its last output:", server_exit.output_text.split("\n"))
