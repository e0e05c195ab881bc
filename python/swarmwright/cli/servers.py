"""`swarmwright servers`: the servers on a broker."""

import os
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._output import Output, complain
from swarmwright.experiment.broker_address import DEFAULT_BROKER
from swarmwright.servers.broker.credentials import prepare

HEADINGS = (
    "id",
    "host/pid",
    "state",
    "reserved for",
    "since",
    "simulations",
    "dimensions",
    "sensors",
    "actuators",
    "metrics",
)
COLORS = {"ready": "green", "busy": "yellow", "lost": "red", "answers": "green"}
USUAL_DIMENSIONS = (1, 2, 3)


@click.command(
    "servers",
    cls=Command,
    example="swarmwright servers --broker mqtt://localhost:1883\nswarmwright servers --watch\n"
    "swarmwright servers --simulation line --dimensions 1",
)
@options.broker_option(default=DEFAULT_BROKER, text="Address of the broker.")
@options.prefix_option
@click.option(
    "--simulation",
    metavar="TITLE",
    help="Also send a discovery for this simulation and list the servers that answer, even without "
    "presence; `presence` and `answers` in --json tell them apart. Needs the account of a tool and "
    "the extra `conformance`.",
)
@click.option(
    "--dimensions",
    type=options.WholeNumber(0, 1000),
    help="With --simulation: required number of dimensions. Default: 1, 2 and 3 are tried.",
)
@click.option(
    "--wait",
    type=options.Seconds(0.0, 3600.0),
    help="Time to listen for announcements, and again for answers to --simulation. Default: 1.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="Refresh until Ctrl-C, showing current work, the blocking server and all active optimization tools.",
)
@click.option(
    "--every", type=options.Seconds(0.1, 3600.0), help="With --watch: refresh interval. Default: 1."
)
@click.option(
    "--forget-lost",
    is_flag=True,
    help="Remove the retained messages of lost servers. Needs the account of a server; a server that "
    "returns announces itself again.",
)
@options.json_option
def command(
    broker: str,
    prefix: str,
    simulation: str | None,
    dimensions: int | None,
    wait: float | None,
    watch: bool,
    every: float | None,
    forget_lost: bool,
    output: Output,
) -> int:
    """List the servers on a broker, or watch them at work.

    Show the simulations of each server, and whether it is ready, busy (and for which tool) or lost.

    Servers announce themselves with presence messages, an extension of the protocol. Servers without it,
    such as those that implement D6.1 alone, are not listed; --simulation finds those that are free.
    """
    from swarmwright import _engine

    options.exclude("--watch", "--wait", "--forget-lost", "--simulation")
    options.exclude("--forget-lost", "--simulation")
    options.need("--every", "--watch")
    options.need("--dimensions", "--simulation")
    if simulation is not None and "," in broker:
        raise click.BadParameter("names several brokers; --simulation needs one.", param_hint="'--broker'")
    if watch:
        from swarmwright.cli._watching import watch as go_on

        return go_on(output, broker, prefix, 1.0 if every is None else every)
    prepare(broker)
    wait = 1.0 if wait is None else wait
    announced = _engine.servers(broker, prefix=prefix, wait=wait)
    if forget_lost:
        return _forget_lost(output, broker, prefix, wait, announced)
    servers: list[Mapping[str, Any]] = list(announced)
    numbers = USUAL_DIMENSIONS if dimensions is None else (dimensions,)
    if simulation is not None:
        servers = _with_answers(servers, broker, simulation, numbers, prefix=prefix, wait=wait)
    for server in servers:
        output.json(server)
    if servers and not output.as_json:
        _list(output, servers)
    if not servers:
        where = f" under the prefix {prefix}" if prefix else ""
        output.text(f"No simulation server on {broker}{where}.")
        if os.environ.get("SWARMWRIGHT_USERNAME"):
            output.text("An account that may not read this prefix sees no servers.")
    if simulation is not None and not any(server["answers"] for server in servers):
        _explain_silence(output, simulation, numbers)
    elif not servers:
        _advise(output, broker, prefix)
    return 0


def _with_answers(
    announced: Sequence[Mapping[str, Any]],
    broker: str,
    simulation: str,
    dimensions: Sequence[int],
    *,
    prefix: str,
    wait: float,
) -> list[Mapping[str, Any]]:
    """Return the servers with presence and those that answer a discovery.

    Their fields `presence` and `answers` tell them apart.
    """
    from swarmwright.servers.broker.client import discover_servers

    answering = {
        answer["server"]: answer
        for answer in discover_servers(broker, simulation, dimensions, prefix=prefix, wait=wait)
    }
    announced_ids = {server["server"] for server in announced}
    servers: list[Mapping[str, Any]] = [
        {**server, "presence": True, "answers": server["server"] in answering} for server in announced
    ]
    servers += [
        {**answer, "presence": False, "answers": True}
        for server, answer in answering.items()
        if server not in announced_ids
    ]
    return sorted(servers, key=lambda server: int(server["server"]))


def _explain_silence(output: Output, simulation: str, dimensions: Sequence[int]) -> None:
    """Print why no server may have answered a discovery."""
    needed = ", ".join(map(str, dimensions))
    output.text(
        f"No server answered a discovery of {simulation!r} (dimensions: {needed}). Reserved servers and "
        "those with another title or other dimensions do not answer, and accounts without permission to "
        "publish discoveries get no answers."
    )


def _advise(output: Output, broker: str, prefix: str) -> None:
    """Print what to do if no server announces itself."""
    option = f" --prefix {shlex.quote(prefix)}" if prefix else ""
    output.text(f"Start one with: swarmwright serve minisim --broker {broker}{option}")
    output.text(
        "Servers without presence, such as those that implement D6.1 alone, are not listed, but runs use "
        f"them. Find them with: swarmwright servers --broker {broker}{option} --simulation TITLE"
    )


def _list(output: Output, servers: Sequence[Mapping[str, Any]]) -> None:
    """Print a table; without a terminal, lines of cells."""
    rows = [row(server) for server in servers]
    if not output.terminal:
        for line in [HEADINGS, *rows]:
            output.cells(line)
        return
    from swarmwright.cli._console import table, text

    colored: list[list[Any]] = [
        [*cells[:2], text(cells[2], COLORS.get(cells[2].partition(",")[0], "")), *cells[3:]] for cells in rows
    ]
    output.console().print(table(output, HEADINGS, colored, {"id", "dimensions", "sensors", "actuators"}))


def _forget_lost(
    output: Output, broker: str, prefix: str, wait: float, servers: Sequence[Mapping[str, Any]]
) -> int:
    """Remove the retained presence of lost servers; return the exit status."""
    from swarmwright import _engine

    lost = {server["server"]: server for server in servers if server.get("state") == "lost"}
    if not lost:
        output.text(f"No server on {broker} is lost.")
        return 0
    forgotten = _engine.forget(broker, list(lost), prefix=prefix, wait=wait)
    for identity, server in lost.items():
        if identity in forgotten:
            output.json({"event": "forgotten", "server": identity})
            output.text(f"server {identity} ({server.get('host')}/{server.get('pid')}) is forgotten")
    remaining = [f"server {identity}" for identity in lost if identity not in forgotten]
    if not remaining:
        return 0
    complain(
        f"{broker} still lists {', '.join(remaining)}: this account may not publish presence; use a server's "
        "account, such as `server` of `swarmwright broker --init`"
    )
    return 1


def row(server: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the table row of a server, a cell per heading; '-' for unknown values."""
    capabilities = server.get("capabilities") or {}
    extension = capabilities.get("swarmwright")
    if not isinstance(extension, dict):  # answers to a discovery are unchecked
        extension = {}

    def cell(*keys: str) -> str:
        for source in (server, capabilities, extension):
            for key in keys:
                if source.get(key) is not None:
                    return str(source[key])
        return "-"

    def names(value: object) -> str:
        return ", ".join(map(str, value)) if isinstance(value, list) and value else "-"

    state = cell("state")
    if server.get("answers"):
        state = f"{state}, answers" if server["presence"] else "answers, without presence"
    return (
        cell("server"),
        f"{cell('host')}/{cell('pid')}",
        state,
        cell("tool"),
        # A last will is fixed when the server connects: its time is not that of the loss.
        "-" if server.get("state") == "lost" else cell("since"),
        names(server.get("simulations")),
        cell("dimensions"),
        cell("sensors"),
        cell("actuators"),
        names(extension.get("metrics")),
    )
