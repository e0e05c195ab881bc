"""Results: one for each rule, and the report of all of them."""

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Literal

from swarmwright.common.untrusted import lines, one_line
from swarmwright.conformance.rules import OWNERS, owner

Status = Literal["passed", "failed", "died", "skipped", "not run"]
BAD: tuple[Status, ...] = ("failed", "died")
_KEYS = {"fix": "mend"}
"""Field of a result -> its key in JSON, where they differ."""
_NOT_SAID = ("advice", "doubt")
"""Fields of a result that are for people only."""


@dataclass(frozen=True)
class Result:
    """The result of one rule.

    source: the rule's origin and section: `D6.1, ...` or `Swarmwright, ...`. status: `died` when the
    peer was gone after it, `not run` when it could not be tried, `skipped` when it does not apply. detail: a
    note, or the reason. sent, came, expected, fix: of a failure. seconds: how long it took. advice: what to
    do so that rules that were skipped apply. doubt: what may be wrong although no rule is violated.
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
        """As a JSON object without empty values and `_NOT_SAID`; `fix` has the key `mend`, for programs."""
        values = {
            _KEYS.get(name, name): value for name, value in asdict(self).items() if name not in _NOT_SAID
        }
        return {key: value for key, value in values.items() if value != ""}


@dataclass
class Report:
    """The results of one peer.

    peer: what was tried, in words.
    """

    peer: str
    results: list[Result] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether nothing failed and nothing was left untried."""
        return not any(result.status in (*BAD, "not run") for result in self.results)

    @property
    def counts(self) -> dict[str, int]:
        """How many results of each status."""
        return dict(Counter(result.status for result in self.results))

    def by_owner(self) -> list[tuple[str, "Report"]]:
        """The results of D6.1's rules, then those of Swarmwright's; none that is empty."""
        parts = [
            (name, Report(self.peer, [result for result in self.results if result.owner == name]))
            for name in OWNERS
        ]
        return [(name, part) for name, part in parts if part.results]

    def of(self, *statuses: Status) -> list[str]:
        """Ids of the rules with one of these statuses."""
        return [result.id for result in self.results if result.status in statuses]

    def __str__(self) -> str:
        """A line of figures, then what failed, D6.1's rules first."""
        said = [one_line(conclusion(self)), *by_source(self)]
        for _, part in self.by_owner():
            said += [explained(result) for result in part.results if result.status in BAD]
        return "\n".join(said)


def summary(report: Report) -> str:
    """Return how many passed, failed and so on."""
    counts = report.counts
    words = [f"{counts[status]} {status}" for status in ("failed", "died", "not run") if status in counts]
    words.append(f"{counts.get('passed', 0)} passed")
    if counts.get("skipped"):
        words.append(f"{counts['skipped']} skipped")
    return ", ".join(words)


def conclusion(report: Report) -> str:
    """Return the line of figures of a peer, with what may be wrong although no rule is violated."""
    doubts = dict.fromkeys(result.doubt for result in report.results if result.doubt)
    return "; ".join([f"{report.peer}: {summary(report)}", *doubts])


def by_source(report: Report) -> list[str]:
    """Return a line for each source of rules: how many passed, which did not."""
    found = []
    for name, part in report.by_owner():
        bad = part.of(*BAD, "not run")
        which = f" ({', '.join(bad)})" if bad else ""
        heading = f"{name}'s rules:"
        found.append(f"{heading:<20} {summary(part)}{which}")
    return found


def explained(result: Result) -> str:
    """Return a failure in words, several lines."""
    said = [f"{result.id} {result.rule} ({result.source})"]
    for label in ("sent", "came", "expected", "fix"):
        text = getattr(result, label)
        if text:
            first, *rest = lines(text)
            said += [f"  {label}: {first}", *(f"    {line}" for line in rest)]
    return "\n".join(said)
