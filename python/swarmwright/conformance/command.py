"""`swarmwright conformance`: checks of a peer against the protocol."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Group
from swarmwright.cli._output import Output, print_note
from swarmwright.common.errors import InputError
from swarmwright.common.json_text import loads

if TYPE_CHECKING:
    from swarmwright.conformance.results import Report, Result
    from swarmwright.conformance.rules import Profile, Rules


@click.group(
    "conformance",
    cls=Group,
    modules={},
    example='swarmwright conformance server --exec "swarmwright serve minisim --broker {broker} --id {id}"',
)
def command() -> None:
    """Check that a server or a tool follows the protocol.

    The peer is a simulation server or an optimization tool in any language; every rule is checked over a
    broker. Rules come from D6.1 or from Swarmwright; --profile d6.1 checks only the former.
    """


_shared = options.combine_options(
    click.option(
        "--exec",
        "start",
        metavar="COMMAND",
        help="Command that starts the peer, with the placeholders above.",
    ),
    options.broker_option(
        default=None,
        text=f"Address of a broker. Default: {options.BROKER_VARIABLE} for a peer that runs already, else an "
        "embedded broker on a free port.",
    ),
    options.peer_prefix_option,
    click.option(
        "--rules",
        multiple=True,
        metavar="IDS",
        help="Check only these rules or groups, such as S2,S4.1; a leading '-' excludes them.",
    ),
    click.option(
        "--profile",
        type=click.Choice(["d6.1", "all"]),
        default="all",
        show_default=True,
        help="d6.1: only the rules of deliverable D6.1; all: Swarmwright's as well.",
    ),
    click.option("--junit", type=options.OutputFile(), help="Also write the results as JUnit XML."),
    click.option("--list", "listing", is_flag=True, help="List the rules without checking them."),
    click.option(
        "--wait",
        type=options.Seconds(0.1, 86400.0),
        default=30.0,
        show_default=True,
        help="Time to wait for the peer at the start.",
    ),
    options.json_option,
)
"""Options shared by both subcommands."""


@command.command(
    "server",
    example='swarmwright conformance server --exec "python my_server.py {broker} {id}" --simulation line\n'
    "swarmwright conformance server --id 7 --broker mqtt://localhost:1883 --junit results.xml",
)
@click.option(
    "--id",
    "server",
    type=options.WholeNumber(0, options.LARGEST_ID),
    help="Id of the server. Default: 1 with --exec, else required.",
)
@click.option(
    "--simulation",
    metavar="TITLE",
    help="Simulation to request. Default: the first in the server's presence message.",
)
@click.option(
    "--dimensions",
    type=float,
    metavar="D",
    help="Spatial dimensions of the simulation. Default: 2, 3 and 1 are tried.",
)
@click.option(
    "--parameters",
    metavar="JSON",
    help="Parameters of the episodes: a JSON object, or a file with one. Several agents, few steps and a "
    "random start cover most rules.",
)
@click.option("--sensors", type=options.WholeNumber(1, 1_000_000), help="Values per agent, if not announced.")
@click.option(
    "--actuators", type=options.WholeNumber(1, 1_000_000), help="Values per agent, if not announced."
)
@click.option(
    "--vary",
    metavar="JSON",
    help="Parameters that change an episode, for simulations that ignore the seed; as --parameters.",
)
@click.option(
    "--timeout",
    type=options.Seconds(0.05, 3600.0),
    default=5.0,
    show_default=True,
    help="Time-out of a single answer.",
)
@click.option(
    "--step-timeout",
    type=options.Seconds(0.1, 86400.0),
    help="Time after which the server aborts an episode, as configured.",
)
@_shared
def server_command(
    output: Output,
    server: int | None,
    parameters: str | None,
    vary: str | None,
    **chosen: Any,  # noqa: ANN401 - as click passes options
) -> int:
    """Try every rule on a simulation server.

    In COMMAND, {broker}, {id} and {prefix} are replaced by the broker's address, the server's id and the
    topic prefix. Without --exec, start the server yourself with the printed address.

    The exit status is 0 if all applicable rules hold, 1 if a rule is broken or could not be tried, 2 if the
    input is wrong.
    """
    from swarmwright.conformance import check_server
    from swarmwright.conformance.server import RULES

    if server is None and chosen["start"] is None and not chosen["listing"]:
        raise click.UsageError("The server is missing: give its --id, or start it with --exec.")
    chosen |= {"parameters": _parameters_of(parameters), "vary": _parameters_of(vary, "--vary")}
    return _check(output, RULES, check_server, server=1 if server is None else server, **chosen)


@command.command(
    "optimizer",
    example='swarmwright conformance optimizer --exec "swarmwright optimize {experiment} --out {folder}/r"\n'
    "swarmwright conformance optimizer --simulation rovers --sensors 8 --actuators 2",
)
@click.option(
    "--simulation", metavar="TITLE", help="Offer only this simulation. Default: any that the tool requests."
)
@click.option(
    "--sensors",
    type=options.WholeNumber(1, 1000),
    default=3,
    show_default=True,
    help="Sensor values per agent.",
)
@click.option(
    "--actuators",
    type=options.WholeNumber(1, 1000),
    default=2,
    show_default=True,
    help="Actuator values per agent.",
)
@click.option(
    "--episodes",
    type=options.WholeNumber(1, 1000),
    metavar="K",
    help="Episodes per candidate; 2 with {experiment}.",
)
@click.option(
    "--lasts",
    type=options.Seconds(0.5, 3600.0),
    default=30.0,
    show_default=True,
    help="Time-out of a single run of the tool.",
)
@_shared
def optimizer_command(output: Output, **chosen: Any) -> int:  # noqa: ANN401 - as above
    """Try every rule on an optimization tool; the kit plays the simulation servers.

    In COMMAND, {broker} and {prefix} are replaced by the broker's address and the topic prefix, {experiment}
    by an experiment file and {folder} by an empty folder. The tool is started for each scenario: servers
    that behave correctly, send invalid messages, fall silent, or are reserved by other tools. Without
    --exec, start it once with the printed address; rules that need further runs are skipped.

    The exit status is 0 if all applicable rules hold, 1 if a rule is broken or could not be tried, 2 if the
    input is wrong.
    """
    from swarmwright.conformance import check_optimizer
    from swarmwright.conformance.optimizer import RULES

    return _check(output, RULES, check_optimizer, **chosen)


def _check(
    output: Output,
    table: "Rules",
    check: Callable[..., "Report"],
    *,
    start: str | None,
    broker: str | None,
    prefix: str | None,
    junit: Path | None,
    listing: bool,
    **chosen: Any,  # noqa: ANN401 - as click passes options
) -> int:
    """Check a peer, or list the rules; return the exit status. chosen: the other arguments of `check`."""
    if listing:
        return _list(output, table, chosen["rules"], chosen["profile"])
    broker = options.peer_broker(broker, start)
    reporter = _Reporter(output)
    report = check(
        command=start,
        broker=broker,
        prefix=options.peer_prefix(prefix, broker),
        tell=reporter.tell,
        say=reporter.say,
        **chosen,
    )
    return reporter.finish(report, table, junit)


def _list(output: Output, rules: "Rules", names: tuple[str, ...], profile: "Profile") -> int:
    from swarmwright.conformance.results import rules_table

    chosen = rules.select(names, profile)
    for line in rules_table(chosen):
        output.text(line)
    for rule in chosen:
        facts = {"id": rule.id, "rule": rule.sentence, "source": rule.source, "where": rule.where}
        output.json({**facts, "needs": list(rule.needs)})
    return 0


def _parameters_of(text: str | None, option: str = "--parameters") -> dict[str, Any]:
    """Parse parameters from the command line: a JSON object, or the name of a file with one.

    Raises InputError.
    """
    if text is None:
        return {}
    source = option
    if not text.lstrip().startswith(("{", "[")):
        source = text
        try:
            text = Path(text).read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(f"{option}: {source}: {error.strerror}") from None
    try:
        value = loads(text)
    except ValueError as error:
        raise InputError(f"{source}: is not valid JSON: {error}") from None
    if not isinstance(value, dict):
        raise InputError(f'{source}: must be a JSON object, such as {{"maxSteps": 5}}')
    return value


class _Reporter:
    """Prints results as they arrive, and a table at the end."""

    def __init__(self, output: Output) -> None:
        self._output = output

    def say(self, text: str) -> None:
        """Print a line for the user."""
        print_note(text)

    def tell(self, result: "Result") -> None:
        """Report a result: a line without a terminal; the table follows at the end."""
        from swarmwright.conformance.results import line

        self._output.json(result.record())
        if self._output.terminal:
            self._output.status(f"{result.id} {result.status}")
        else:
            self._output.block(line(result))

    def finish(self, report: "Report", rules: "Rules", junit: Path | None) -> int:
        """Print the table and write the file; return the exit status."""
        from swarmwright.conformance.results import conclusion, list_sources, print_table, write_junit

        for advice in dict.fromkeys(result.advice for result in report.results if result.advice):
            self.say(advice)
        if junit is not None:
            write_junit(report, junit, rules.groups)
        if self._output.terminal:
            self._output.status("")
            print_table(self._output.console(), report, rules.groups, unicode=self._output.unicode)
        else:
            for text in list_sources(report):
                self._output.text(text)
            self._output.text(conclusion(report))
        self._output.json({"peer": report.peer, "ok": report.ok, **report.counts})
        return 0 if report.ok else 1
