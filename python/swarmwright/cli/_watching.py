"""`swarmwright servers --watch`: all peers on a broker, redrawn each second."""

import datetime as dt
from contextlib import suppress
from typing import TYPE_CHECKING

from swarmwright.cli._output import Output
from swarmwright.common.formatting import format_count, format_duration
from swarmwright.servers.broker.watching import (
    SILENCE_S,
    ServerRow,
    ToolRow,
    View,
    describe_abandoned,
    describe_owed_message,
    describe_work,
    watch_broker,
)

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.text import Text

COLORS = {"ready": "green", "busy": "yellow", "lost": "red"}
SERVERS = ("id", "state", "simulations", "reserved for", "work", "silent", "speed", "failures")
TOOLS = ("tool", "run", "generations done", "evaluations", "waits for")
RIGHT = ("id", "silent", "speed")
NARROW = 60
"""Width of a terminal, in columns, below which only the following cells are drawn."""
NARROW_SERVERS = ("id", "state", "work", "silent")
NARROW_TOOLS = ("tool", "generations done", "evaluations")


def cells(server: ServerRow) -> tuple[str, ...]:
    """Return the table row of a server, a cell per heading."""
    use = server.use
    speed = use.get("speed")
    failures = str(use["failures"]) if use.get("failures") else "-"
    if use.get("benched") is not None:
        failures += f", paused for {format_duration(use['benched'])}"
    return (
        str(server.server),
        server.state or "-",
        ", ".join(server.simulations) or "-",
        server.tool or "-",
        describe_work(server),
        format_duration(server.silent) if server.silent >= SILENCE_S else "-",
        "-" if speed is None else f"{speed:.3g}/s",
        failures,
    )


def tool_cells(tool: ToolRow) -> tuple[str, ...]:
    """Return the table row of a tool, a cell per heading."""
    status = tool.status
    generation, generations = status.get("generation"), status.get("generations")
    # The index of the current generation, from 0, is the number of finished ones.
    how_far = "-" if generation is None else str(generation)
    if generation is not None and generations is not None:
        how_far += f" of {generations}"
    evaluations = (
        "looks for servers" if status["state"] == "looking" else f"{status['done']} of {status['total']}"
    )
    return (status["tool"], status.get("run") or "-", how_far, evaluations, tool.waits_for or "-")


def headline(view: View, broker: str) -> tuple[str, str]:
    """Return a line with the overall state, and its style."""
    if view.broker_lost is not None:
        return f"{broker} is lost ({view.broker_lost}); trying again", "bold red"
    if view.blocking is not None:
        return f"Blocking: {describe_owed_message(view.blocking)}", "bold red"
    alone = next((tool for tool in view.tools if tool.waits_for), None)
    if alone is not None:
        return f"{alone.status['tool']}: {alone.waits_for}", "bold yellow"
    if view.abandoned:
        first, *more = view.abandoned
        return describe_abandoned(first, view) + (f" (+{len(more)})" if more else ""), "bold yellow"
    return f"{format_count(len(view.servers), 'server')}, none blocking", "dim"


def _format_progress(tool: ToolRow) -> str:
    """Return a tool's progress in coarse steps, so that it changes rarely."""
    _, run, how_far, _, _ = tool_cells(tool)
    status = tool.status
    if status["state"] == "looking" or not status["total"]:
        return f"run {run}"
    if status.get("generation") is None:
        tenths = 10 * status["done"] // status["total"]
        return f"run {run}, {10 * tenths} % of {status['total']} evaluations"
    return f"run {run}, {how_far} generations done"


class Screen:
    """The redrawn view on a terminal."""

    def __init__(self, output: Output, broker: str) -> None:
        self._output = output
        self._broker = broker
        self.view: View | None = None

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw a line and two tables."""
        from swarmwright.cli._console import text

        if self.view is None:
            yield text(f"Listening on {self._broker} ..", style="dim")
            return
        narrow = options.max_width < NARROW
        blocking = self.view.blocking
        servers: list[list[str | Text]] = []
        for server in self.view.servers:
            row = cells(server)
            mark = "bold red" if server is blocking else "yellow" if server.silent >= SILENCE_S else ""
            state = text(row[1], COLORS.get(row[1], ""))
            marked = (text(cell, mark) for cell in row[4:6])
            servers.append([text(row[0], mark), state, *row[2:4], *marked, *row[6:]])
        tools: list[list[str | Text]] = []
        for tool in self.view.tools:
            row = tool_cells(tool)
            tools.append([*row[:4], text(row[4], "yellow" if tool.waits_for else "")])
        yield text(*headline(self.view, self._broker))
        yield self._table(TOOLS, tools, NARROW_TOOLS if narrow else TOOLS) if tools else ""
        yield self._table(SERVERS, servers, NARROW_SERVERS if narrow else SERVERS)

    def _table(
        self, headings: tuple[str, ...], rows: "list[list[str | Text]]", shown: tuple[str, ...]
    ) -> "RenderableType":
        from swarmwright.cli._console import table

        columns = [headings.index(heading) for heading in shown]
        return table(self._output, shown, ([row[column] for column in columns] for row in rows), RIGHT)


class Lines:
    """The view without a terminal: a line for each change."""

    def __init__(self, output: Output, broker: str) -> None:
        self._output = output
        self._broker = broker
        self._last: dict[str, str] = {}

    def show(self, view: View) -> None:
        """Print the changes since the last view."""
        now: dict[str, str] = {}
        for server in view.servers:
            held = f" for {server.tool}" if server.tool and server.state == "busy" else ""
            benched = server.use.get("benched") is not None
            pause = f", paused: {server.use.get('reason')}" if benched else ""
            offered = f" ({', '.join(server.simulations)})" if server.simulations else ""
            now[f"server {server.server}"] = f"{server.state or 'known to a tool'}{held}{offered}{pause}"
        for tool in view.tools:
            now[f"tool {tool.status['tool']}"] = _format_progress(tool)
        blocking = view.blocking
        if view.broker_lost is not None:
            now["broker"] = headline(view, self._broker)[0]
        elif blocking is not None:
            # Repeated with each doubling of the silence, not each second.
            doubled = int(blocking.silent).bit_length()
            now[f"waited for {doubled}"] = describe_owed_message(blocking)
        for server in view.abandoned:
            now[f"waited for the tool of {server.server}"] = describe_abandoned(server, view)
        for key, message in now.items():
            if self._last.get(key) != message and not (key.startswith("waited") and key in self._last):
                self._say(message if key == "broker" or key.startswith("waited") else f"{key}: {message}")
        for key in self._last:
            if key not in now and key.startswith(("server", "tool")):
                self._say(f"{key} has left")
            elif key == "broker" and key not in now:
                self._say(f"{self._broker} is back")
        self._last = now

    def _say(self, text: str) -> None:
        self._output.text(f"{dt.datetime.now().astimezone():%H:%M:%S}  {text}")


def watch(output: Output, broker: str, prefix: str, every: float) -> int:
    """Show the state until Ctrl-C, which is the normal end; return the exit status."""
    with suppress(KeyboardInterrupt):
        _show(output, broker, prefix, every)
    return 0


def _show(output: Output, broker: str, prefix: str, every: float) -> None:
    if output.as_json:
        for view in watch_broker(broker, prefix=prefix, every=every):
            moment = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
            output.json({"time": moment, **view.record()})
    elif not output.terminal:
        lines = Lines(output, broker)
        for view in watch_broker(broker, prefix=prefix, every=every):
            lines.show(view)
    else:
        from rich.live import Live

        screen = Screen(output, broker)
        shown = watch_broker(broker, prefix=prefix, every=every)
        first = next(shown)  # reports an unreachable broker before anything is drawn
        screen.view = first
        with Live(screen, console=output.console(), refresh_per_second=4, vertical_overflow="ellipsis"):
            for view in shown:
                screen.view = view
