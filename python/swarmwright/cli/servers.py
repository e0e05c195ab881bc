"""`swarmwright servers`: the servers on a broker."""

from collections.abc import Mapping
from typing import Any

import click

from swarmwright.broker.credentials import prepare
from swarmwright.cli._commands import Command
from swarmwright.cli._options import DEFAULT_BROKER, RealNumber, broker_option, json_option, prefix_option
from swarmwright.cli._output import Output

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
@json_option
def command(
    broker: str, prefix: str, wait: float | None, watch: bool, every: float | None, as_json: bool
) -> int:
    """List the servers on a broker, or watch them at work.

    What each simulation server offers, and whether it is ready, busy (and for whom) or lost.
    """
    from swarmwright import _engine

    if watch and wait is not None:
        raise click.UsageError("--wait says how long to listen before the list is printed; --watch goes on")
    if not watch and every is not None:
        raise click.UsageError("--every goes with --watch")
    output = Output(as_json=as_json)
    if watch:
        from swarmwright.cli._watching import watch as go_on

        return go_on(output, broker, prefix, 1.0 if every is None else every)
    prepare(broker)
    found = _engine.servers(broker, prefix=prefix, wait=1.0 if wait is None else wait)
    for server in found:
        output.json(server)
    if as_json:
        return 0
    if not found:
        output.text(f"No simulation server on {broker}.")
        output.text(f"Start one with: swarmwright serve minisim --broker {broker}")
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
        cell("since"),
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
