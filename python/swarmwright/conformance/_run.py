"""Tries rules one after the other with deadlines, and distinguishes a broken rule from a dead peer."""

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from swarmwright.conformance.results import BAD, Result
from swarmwright.conformance.rules import Note, NotTried, Rule, Skip
from swarmwright.servers.broker.client import Failure, Overdue


class Peer(Protocol):
    """What a run needs of a peer."""

    def ready(self, rule: Rule) -> None:
        """Get ready for a rule: forget what came, set the deadline."""
        ...

    def recover(self) -> str:
        """Bring the peer back to where the next rule can begin; why that is not possible, empty if it is."""
        ...

    def revive(self) -> bool:
        """Start it anew, where that is possible; whether it was."""
        ...

    def gone(self) -> str:
        """How its process ended, in words; empty when it has not ended, or that is not known."""
        ...


def run(peer: Peer, rules: Sequence[Rule], tell: Callable[[Result], None]) -> list[Result]:
    """Try rules on a peer; `tell` gets each result at once."""
    results: dict[str, Result] = {}
    lost = ""
    for rule in rules:
        unmet = next(
            (need for need in rule.needs if need in results and results[need].status in (*BAD, "not run")),
            None,
        )
        if lost:
            result = _result(rule, "not run", lost)
        elif unmet:
            result = _result(rule, "not run", f"needs {unmet}")
        else:
            result = _tried(peer, rule)
            if result.status == "died" and not peer.revive():
                lost = f"the peer was gone after {rule.id}"
        results[rule.id] = result
        tell(result)
    return list(results.values())


def _result(rule: Rule, status: str, detail: str = "", **more: object) -> Result:
    return Result(rule.id, rule.sentence, rule.source, rule.where, status, detail, **more)  # type: ignore[arg-type]


def _tried(peer: Peer, rule: Rule) -> Result:
    start = time.monotonic()
    status, detail, advice, doubt, failure = "passed", "", "", "", None
    try:
        peer.ready(rule)
        said = rule.check(peer)
        note = said if isinstance(said, Note) else Note(said or "")
        detail, doubt = note.text, note.doubt
    except Skip as skip:
        status, detail, advice, doubt = "skipped", str(skip), skip.advice, skip.doubt
    except NotTried as unknown:
        status, detail = "not run", str(unknown)
    except Failure as one:
        status, failure = "failed", one
    except Overdue:
        status = "failed"
        failure = Failure(f"it was not over after {time.monotonic() - start:.0f} s", "an end in time")
    seconds = time.monotonic() - start
    lost = peer.recover()
    if lost:
        before = f"{failure.came}; then " if failure else ""
        failure = Failure(
            before + (peer.gone() or lost),
            failure.expected if failure else "alive and free after the rule",
            failure.sent if failure else "",
        )
        status = "died"
    if failure is None:
        return _result(rule, status, detail, seconds=seconds, advice=advice, doubt=doubt)
    return _result(
        rule,
        status,
        sent=failure.sent,
        came=failure.came,
        expected=failure.expected,
        fix=rule.fix,
        seconds=seconds,
    )
