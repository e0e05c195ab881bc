"""`swarmwright serve`: simulation servers."""

import json
import secrets
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright._credentials import from_keyring
from swarmwright._suggest import unknown
from swarmwright.cli._commands import Command
from swarmwright.cli._log import Log
from swarmwright.cli._observing import Observing, observe_options, observed_servers
from swarmwright.cli._options import (
    DEFAULT_BROKER,
    WholeNumber,
    broker_option,
    json_option,
    prefix_option,
    wait_option,
)
from swarmwright.cli._output import Output
from swarmwright.cli._signals import Terminated
from swarmwright.cli._supervisor import Ended, Event, Supervisor

if TYPE_CHECKING:
    from swarmwright._prometheus import ServeFigures

LARGEST_ID = 2**31 - 1


@click.command(
    "serve",
    cls=Command,
    example="swarmwright serve minisim --count 4\nswarmwright serve gather.py:Gather --broker mqtt://localhost:1883",
)
@click.argument("simulation", metavar="SIMULATION")
@broker_option(default=DEFAULT_BROKER, text="Address of the broker.")
@click.option(
    "--id",
    "first",
    type=WholeNumber(0, LARGEST_ID),
    metavar="N",
    help="Id of the first server; the others count on from it. Default: random.",
)
@click.option(
    "--count", type=WholeNumber(1, 1024), default=1, show_default=True, metavar="K", help="How many."
)
@prefix_option
@click.option(
    "--step-timeout",
    type=click.FloatRange(0.1, 86400.0),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="How long an episode may wait for an agent's actuators before it is given up.",
)
@wait_option
@observe_options
@json_option
def command(
    simulation: str,
    broker: str,
    first: int | None,
    count: int,
    prefix: str,
    step_timeout: float,
    wait: float | None,
    log: Path | None,
    log_level: str,
    metrics: tuple[str, int] | None,
    as_json: bool,
) -> int:
    """Offer a SIMULATION on a broker until Ctrl-C.

    SIMULATION is the title of one that is built in, or a class in Python, as path/to/file.py:Class or
    package.module:Class, which derives from swarmwright.Simulation, or an environment of another library, as
    gymnasium:CartPole-v1 or pettingzoo:mpe2.simple_spread_v3?N=5.

    Every server is a process of its own and serves one optimization tool at a time.
    """
    title = _title(simulation)
    if first is None:
        first = 1 + secrets.randbelow(LARGEST_ID - count + 1)
    elif first + count - 1 > LARGEST_ID:
        raise click.UsageError(f"--id {first} with --count {count} passes the largest id, {LARGEST_ID}.")
    shared = {
        "simulation": simulation,
        "broker": broker,
        "prefix": prefix,
        "step_timeout": step_timeout,
        "wait": wait or 0.0,
    }
    settings = [{**shared, "id": first + i} for i in range(count)]
    from_keyring(broker)
    output = Output(as_json=as_json)
    with observed_servers(output, Observing(log, log_level, metrics)) as (lines, figures):
        reporter = Reporter(output, title, broker, lines, figures)
        try:
            with Supervisor(settings) as servers:
                for item in servers.news():
                    reporter.tell(item)
        except Terminated:
            pass  # SIGTERM is how a service is asked to end
    return reporter.status


def _title(simulation: str) -> str:
    """The title of what is to be offered; complains before any server is started."""
    from swarmwright import _simulations
    from swarmwright._own._names import is_own

    if is_own(simulation):
        return _simulations.title(simulation)
    known = _simulations.titles()
    if simulation not in known:
        raise click.UsageError(
            f"{unknown('simulation', simulation, known)}; a class in Python is named like file.py:Class"
        )
    return simulation


class Reporter:
    """Tells a person or a script what happens to the servers.

    status: the exit status that what happened so far amounts to.
    """

    def __init__(
        self,
        output: Output,
        simulation: str,
        broker: str,
        log: Log | None = None,
        figures: "ServeFigures | None" = None,
    ) -> None:
        self.status = 0
        self._output = output
        self._log = Log(None) if log is None else log
        self._figures = figures
        self._offer = f"{simulation} on {broker}"
        self._last: dict[int, str] = {}
        self._errors: dict[int, str] = {}

    def tell(self, item: Event | Ended) -> None:
        """Report one piece of news."""
        self._note(item)
        if isinstance(item, Ended):
            self._ended(item)
            return
        if item.report.get("event") == "error":
            self._errors[item.server] = str(item.report.get("message"))
            return
        self._output.json({"server": item.server, "pid": item.pid, **item.report})
        if item.report.get("event") == "failure":
            self._output.text(f"server {item.server}: {item.report['message']}")
            self._output.text("\n".join(f"  {line}" for line in str(item.report["traceback"]).splitlines()))
            return
        line = self._sentence(item.server, item.pid, item.report)
        if line != self._last.get(item.server):
            self._output.text(line)
            self._last[item.server] = line

    def _note(self, item: Event | Ended) -> None:
        """Tell programs."""
        if isinstance(item, Ended):
            event, level = "ended", "error" if item.status else "info"
            fields: dict[str, Any] = {"status": item.status, "message": item.last_words or None}
        else:
            event = str(item.report.get("event"))
            level = {"ready": "info", "busy": "info", "error": "error"}.get(event, "warning")
            fields = {key: value for key, value in item.report.items() if key not in {"event", "server"}}
        self._log.write(level, f"server_{event}", server=item.server, pid=item.pid, **fields)
        if self._figures is not None:
            self._figures.event(item.server, event)

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

    def _ended(self, item: Ended) -> None:
        error = self._errors.get(item.server)
        self.status = max(self.status, 2 if item.status == 2 and error else 1)
        self._output.json(
            {
                "event": "ended",
                "server": item.server,
                "pid": item.pid,
                "status": item.status,
                "message": error or item.last_words,
            }
        )
        if error:
            click.echo(f"swarmwright: server {item.server}: {error}", err=True)
            return
        how = f"was killed by {signal_name(-item.status)}" if item.status < 0 else f"ended with {item.status}"
        click.echo(f"swarmwright: server {item.server} (process {item.pid}) {how}", err=True)
        if item.last_words:
            click.echo(
                "its last words:\n" + "\n".join(f"  {w}" for w in item.last_words.splitlines()), err=True
            )


def signal_name(number: int) -> str:
    """The name of a signal: 9 -> 'SIGKILL'."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
