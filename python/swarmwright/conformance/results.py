"""Results of the rules: in Python, as lines and tables, and as JUnit XML."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from swarmwright.common.errors import RunError
from swarmwright.common.untrusted import escape_line, escape_lines
from swarmwright.conformance.rules import OWNERS, Rule, owner

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


Status = Literal["passed", "failed", "died", "skipped", "not run"]
BAD: tuple[Status, ...] = ("failed", "died")
_KEYS = {"fix": "mend"}
"""Key in JSON of a result's field, if its name differs."""
_NOT_SAID = ("advice", "doubt")
"""Fields of a result that JSON omits."""


@dataclass(frozen=True)
class Result:
    """The result of one rule.

    source: the rule's origin and section: `D6.1, ...` or `Swarmwright, ...`. status: `died` if the peer was
    no longer running afterwards, `not run` if the rule could not be tried, `skipped` if it does not apply.
    detail: a note, or the reason. sent, came, expected, fix: details of a failure. seconds: duration. advice:
    how to make skipped rules apply. doubt: what may be wrong although no rule is violated.
    """

    id: str
    rule: str
    source: str
    where: str
    status: Status
    detail: str = ""
    sent: str = ""
    came: str = ""
    expected: str = ""
    fix: str = ""
    seconds: float = 0.0
    advice: str = ""
    doubt: str = ""

    @property
    def owner(self) -> str:
        """The rule's origin: D6.1 or Swarmwright."""
        return owner(self.source)

    def record(self) -> dict[str, object]:
        """Return a JSON object without empty values and `_NOT_SAID`; the key of `fix` is `mend`."""
        values = {
            _KEYS.get(name, name): value for name, value in asdict(self).items() if name not in _NOT_SAID
        }
        return {key: value for key, value in values.items() if value != ""}


@dataclass
class Report:
    """The results of one peer.

    peer: description of the peer.
    """

    peer: str
    results: list[Result] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether all applicable rules were tried and hold."""
        return not any(result.status in (*BAD, "not run") for result in self.results)

    @property
    def counts(self) -> dict[str, int]:
        """Number of results per status."""
        return dict(Counter(result.status for result in self.results))

    def group_by_owner(self) -> list[tuple[str, "Report"]]:
        """Return the results of D6.1's rules, then of Swarmwright's; empty groups are omitted."""
        parts = [
            (name, Report(self.peer, [result for result in self.results if result.owner == name]))
            for name in OWNERS
        ]
        return [(name, part) for name, part in parts if part.results]

    def list_ids(self, *statuses: Status) -> list[str]:
        """Return the ids of the rules with one of these statuses."""
        return [result.id for result in self.results if result.status in statuses]

    def __str__(self) -> str:
        """Return a summary line, then the failures, D6.1's rules first."""
        lines = [escape_line(conclusion(self)), *list_sources(self)]
        for _, part in self.group_by_owner():
            lines += [explain_failure(result) for result in part.results if result.status in BAD]
        return "\n".join(lines)


def summary(report: Report) -> str:
    """Return the number of rules per status."""
    counts = report.counts
    words = [f"{counts[status]} {status}" for status in ("failed", "died", "not run") if status in counts]
    words.append(f"{counts.get('passed', 0)} passed")
    if counts.get("skipped"):
        words.append(f"{counts['skipped']} skipped")
    return ", ".join(words)


def conclusion(report: Report) -> str:
    """Return the summary line of a peer, with doubts about rules that are not violated."""
    doubts = dict.fromkeys(result.doubt for result in report.results if result.doubt)
    return "; ".join([f"{report.peer}: {summary(report)}", *doubts])


def list_sources(report: Report) -> list[str]:
    """Return a line for each source of rules: the number that passed, and the failures."""
    lines = []
    for name, part in report.group_by_owner():
        bad = part.list_ids(*BAD, "not run")
        failures = f" ({', '.join(bad)})" if bad else ""
        heading = f"{name}'s rules:"
        lines.append(f"{heading:<20} {summary(part)}{failures}")
    return lines


def explain_failure(result: Result) -> str:
    """Describe a failure in several lines."""
    lines = [f"{result.id} {result.rule} ({result.source})"]
    for label in ("sent", "came", "expected", "fix"):
        text = getattr(result, label)
        if text:
            first, *rest = escape_lines(text)
            lines += [f"  {label}: {first}", *(f"    {line}" for line in rest)]
    return "\n".join(lines)


_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(report: Report, path: Path, groups: Mapping[str, str]) -> None:
    """Write a suite for each group of rules, a case for each rule.

    Raises RunError if the file cannot be written.
    """
    root = Element("testsuites", name=_text(report.peer), **_figures(report.results))
    for group, title in groups.items():
        results = [result for result in report.results if result.id.partition(".")[0] == group]
        if not results:
            continue
        suite = SubElement(root, "testsuite", name=f"{group} {title}", **_figures(results))
        for result in results:
            _case(suite, result, f"conformance.{group}")
    indent(root)
    try:
        ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise RunError(f"--junit: {path}: {error.strerror}") from None


def _case(suite: Element, result: Result, name: str) -> None:
    case = SubElement(
        suite, "testcase", classname=name, name=f"{result.id} {result.rule}", time=f"{result.seconds:.3f}"
    )
    properties = SubElement(case, "properties")
    SubElement(properties, "property", name="source", value=_text(result.source))
    if result.status in {"failed", "died"}:
        kind = "failure" if result.status == "failed" else "error"
        SubElement(case, kind, message=_text(result.came)).text = _text(explain_failure(result))
    elif result.status in {"skipped", "not run"}:
        SubElement(case, "skipped", message=_text(f"{result.status}: {result.detail}"))
    elif result.detail:
        SubElement(case, "system-out").text = _text(result.detail)


def _figures(results: list[Result]) -> Any:  # noqa: ANN401 - attributes, as the library wants them
    def count(*statuses: str) -> str:
        return str(sum(result.status in statuses for result in results))

    return {
        "tests": str(len(results)),
        "failures": count("failed"),
        "errors": count("died"),
        "skipped": count("skipped", "not run"),
        "time": f"{sum(result.seconds for result in results):.3f}",
    }


def _text(text: str) -> str:
    """Remove characters that XML does not allow."""
    return _FORBIDDEN.sub("?", text)


COLORS = {"passed": "green", "failed": "red", "died": "red", "skipped": "yellow", "not run": "yellow"}


def line(result: Result) -> str:
    """Format a result as a line of plain text, with indented details below."""
    detail = f": {result.detail}" if result.detail else ""
    first, *rest = escape_lines(f"{result.status:8} {result.id:6} {result.owner:11} {result.rule}{detail}")
    if result.status in BAD:
        rest += escape_lines(explain_failure(result))[1:]
    return "\n".join([first, *(f"         {part}" for part in rest)])


def print_table(console: "Console", report: Report, groups: Mapping[str, str], *, unicode: bool) -> None:
    """Print a table of all results, D6.1's rules first, with failures in full below."""
    from rich import box  # noqa: PLC0415 - only where a table is printed
    from rich.table import Table  # noqa: PLC0415 - only where a table is printed
    from rich.text import Text  # noqa: PLC0415 - only where a table is printed

    table = Table(box=box.SIMPLE_HEAD if unicode else box.ASCII, pad_edge=False)
    for heading in ("rule", "", "", "result", "s"):
        table.add_column(heading, justify="right" if heading == "s" else "left")
    table.columns[0].no_wrap = table.columns[2].no_wrap = True
    for name, part in report.group_by_owner():
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
    for _, part in report.group_by_owner():
        for result in part.results:
            if result.status in BAD:
                console.print(explain_failure(result), "\n", sep="", markup=False, highlight=False)
    for text in list_sources(report):
        console.print(text, highlight=False)
    console.print(conclusion(report))


def rules_table(rules: Sequence[Rule]) -> list[str]:
    """Format rules as lines of plain text."""
    return [f"{rule.id:6} {rule.sentence} ({rule.source})" for rule in rules]
