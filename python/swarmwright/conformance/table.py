"""Results as a table for people."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from swarmwright.common.untrusted import lines
from swarmwright.conformance.results import BAD, Report, Result, by_source, conclusion, explained
from swarmwright.conformance.rules import Rule

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

COLORS = {"passed": "green", "failed": "red", "died": "red", "skipped": "yellow", "not run": "yellow"}


def line(result: Result) -> str:
    """A result as a line of plain text; what does not fit in it is indented below."""
    detail = f": {result.detail}" if result.detail else ""
    first, *rest = lines(f"{result.status:8} {result.id:6} {result.owner:11} {result.rule}{detail}")
    if result.status in BAD:
        rest += lines(explained(result))[1:]
    return "\n".join([first, *(f"         {part}" for part in rest)])


def print_table(console: "Console", report: Report, groups: Mapping[str, str], *, unicode: bool) -> None:
    """Print all results, D6.1's rules first, and what failed in full below."""
    from rich import box  # noqa: PLC0415 - only where a table is printed
    from rich.table import Table  # noqa: PLC0415 - only where a table is printed
    from rich.text import Text  # noqa: PLC0415 - only where a table is printed

    table = Table(box=box.SIMPLE_HEAD if unicode else box.ASCII, pad_edge=False)
    for heading in ("rule", "", "", "result", "s"):
        table.add_column(heading, justify="right" if heading == "s" else "left")
    table.columns[0].no_wrap = table.columns[2].no_wrap = True
    for name, part in report.by_owner():
        group = ""
        for result in part.results:
            if result.id.partition(".")[0] != group:
                group = result.id.partition(".")[0]
                table.add_row(Text(group, "bold"), Text(f"{groups[group]} ({name})", "bold"))
            cells: Sequence[RenderableType] = (
                result.id,
                result.rule,
                Text(result.status, COLORS[result.status]),
                Text(result.detail or result.came),
                f"{result.seconds:.2f}" if result.seconds else "",
            )
            table.add_row(*cells)
    console.print(table)
    for _, part in report.by_owner():
        for result in part.results:
            if result.status in BAD:
                console.print(explained(result), "\n", sep="", markup=False, highlight=False)
    for text in by_source(report):
        console.print(text, highlight=False)
    console.print(conclusion(report))


def rules_table(rules: Sequence[Rule]) -> list[str]:
    """Rules as lines of plain text."""
    return [f"{rule.id:6} {rule.sentence} ({rule.source})" for rule in rules]
