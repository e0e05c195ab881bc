"""`swarmwright servers`: the servers on a broker."""

import os
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import click

from swarmwright.broker.credentials import prepare
from swarmwright.cli._commands import Command
from swarmwright.cli._options import DEFAULT_BROKER, RealNumber, broker_option, json_option, prefix_option
from swarmwright.cli._output import Output, complain

HEADINGS = (
    "id",
    "host/pid",
    "state",
    "for whom",
    "since",
    "simulations",
    "dimensions",
    "sensors",
    "actuators",
    "metrics",
)
COLORS = {"ready": "green", "busy": "yellow", "lost": "red"}


@click.command(
    "servers",
    cls=Command,
    example="swarmwright servers --broker mqtt://localhost:1883\nswarmwright servers --watch",
)
@broker_option(default=DEFAULT_BROKER, text="Address of the broker.")
@prefix_option
@click.option(
    "--wait",
    type=RealNumber(0.0, 3600.0),
    metavar="SECONDS",
    help="How long to listen for answers. Default: 1.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="Refresh until Ctrl-C: what each server does, which one is blocking, and every active optimization "
    "tool. With --json, one object every --every seconds.",
)
@click.option(
    "--every",
    type=RealNumber(0.1, 3600.0),
    metavar="SECONDS",
    help="With --watch: how often it is shown. Default: 1.",
)
@click.option(
    "--forget-lost",
    is_flag=True,
    help="Remove what the broker keeps of lost servers, whose process was killed or whose machine is gone. "
    "Needs the account of a server; one that is back announces itself again.",
)
@json_option
def command(
    broker: str,
    prefix: str,
    wait: float | None,
    watch: bool,
    every: float | None,
    forget_lost: bool,
    as_json: bool,
) -> int:
    """List the servers on a broker, or watch them at work.

    What each simulation server offers, and whether it is ready, busy (and for whom) or lost.
    """
    from swarmwright import _engine

    if watch and wait is not None:
        raise click.UsageError("--wait says how long to listen before the list is printed; --watch goes on")
    if not watch and every is not None:
        raise click.UsageError("--every goes with --watch")
    if watch and forget_lost:
        raise click.UsageError("--forget-lost ends when it is done; --watch goes on")
    output = Output(as_json=as_json)
    if watch:
        from swarmwright.cli._watching import watch as go_on

        return go_on(output, broker, prefix, 1.0 if every is None else every)
    prepare(broker)
    wait = 1.0 if wait is None else wait
    found = _engine.servers(broker, prefix=prefix, wait=wait)
    if forget_lost:
        return _forget_lost(output, broker, prefix, wait, found)
    for server in found:
        output.json(server)
    if as_json:
        return 0
    if not found:
        where = f" under the prefix {prefix}" if prefix else ""
        option = f" --prefix {shlex.quote(prefix)}" if prefix else ""
        output.text(f"No simulation server on {broker}{where}.")
        if os.environ.get("SWARMWRIGHT_USERNAME"):
            output.text("An account that may not read this prefix sees none either.")
        output.text(f"Start one with: swarmwright serve minisim --broker {broker}{option}")
        output.text(
            "Servers that implement D6.1 only do not announce themselves: `optimize` finds them by "
            "their simulation."
        )
        return 0
    rows = [row(server) for server in found]
    if output.terminal:
        _table(output, rows)
    else:
        for line in [HEADINGS, *rows]:
            output.cells(line)
    return 0


def _forget_lost(
    output: Output, broker: str, prefix: str, wait: float, found: Sequence[Mapping[str, Any]]
) -> int:
    """Remove the presence of lost servers, which is retained; the exit status."""
    from swarmwright import _engine

    lost = {server["server"]: server for server in found if server.get("state") == "lost"}
    if not lost:
        output.text(f"No server on {broker} is lost.")
        return 0
    forgotten = _engine.forget(broker, list(lost), prefix=prefix, wait=wait)
    for identity, server in lost.items():
        if identity in forgotten:
            output.json({"event": "forgotten", "server": identity})
            output.text(f"server {identity} ({server.get('host')}/{server.get('pid')}) is forgotten")
    kept = [f"server {identity}" for identity in lost if identity not in forgotten]
    if not kept:
        return 0
    complain(
        f"{broker} keeps {', '.join(kept)}: it does not let this account publish presence; use that of a "
        "server, such as `server` of `swarmwright broker --init`"
    )
    return 1


def row(server: Mapping[str, Any]) -> tuple[str, ...]:
    """What the table says of one server, a cell per heading; '-' where it does not say."""
    capabilities = server.get("capabilities") or {}
    extension = capabilities.get("swarmwright") or {}

    def cell(*keys: str) -> str:
        for source in (server, capabilities, extension):
            for key in keys:
                if source.get(key) is not None:
                    return str(source[key])
        return "-"

    return (
        cell("server"),
        f"{cell('host')}/{cell('pid')}",
        cell("state"),
        cell("tool"),
        # A last will is fixed when the server connects: its time is not that of the loss.
        "-" if server.get("state") == "lost" else cell("since"),
        ", ".join(map(str, server.get("simulations") or ["-"])),
        cell("dimensions"),
        cell("sensors"),
        cell("actuators"),
        ", ".join(map(str, extension.get("metrics") or ["-"])),
    )


def _table(output: Output, rows: list[tuple[str, ...]]) -> None:
    from rich import box
    from rich.table import Table

    from swarmwright.cli._console import add_row, text

    table = Table(box=box.SIMPLE_HEAD if output.unicode else box.ASCII, pad_edge=False)
    for heading in HEADINGS:
        right = heading in ("id", "dimensions", "sensors", "actuators")
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    for cells in rows:
        state = cells[2]
        add_row(table, [*cells[:2], text(state, COLORS.get(state, "")), *cells[3:]])
    output.console().print(table)
