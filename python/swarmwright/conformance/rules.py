"""Rules: the requirement, its source, and the code that tries it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean
from swarmwright.servers.broker.client import Failure

Side = Literal["server", "optimizer"]
Profile = Literal["d6.1", "all"]
"""The rules to try: only those of D6.1, or all."""
OWNERS = ("D6.1", "Swarmwright")
"""Origins of rules, in the order in which reports show them."""


class Skip(Exception):  # noqa: N818 - it is not an error
    """The rule does not apply here; the message says why.

    Args:
        reason: the message.
        advice: how to make such rules apply, printed once; may be empty.
        doubt: what may be wrong with the peer although no rule is violated, in a few words for the summary
            line; may be empty.
    """

    def __init__(self, reason: str, advice: str = "", doubt: str = "") -> None:
        super().__init__(reason)
        self.advice = advice
        self.doubt = doubt


@dataclass(frozen=True)
class Note:
    """A remark on a rule that passed.

    doubt: as in `Skip`.
    """

    text: str
    doubt: str = ""


Check = Callable[[Any], Note | str | None]
"""Function that tries a rule on a peer."""


class NotTried(Exception):  # noqa: N818 - it is not an error
    """Information that the rule needs is missing; the message names it."""


class WentOn(Failure):
    """The server continued although it should have waited.

    D6.1 does not say that a server waits, so this violates its rules only if the server waits in other cases.
    """


@dataclass(frozen=True)
class Rule:
    """A rule. `check` gets the peer, returns a note or None, and raises Failure, Skip or NotTried.

    id: group and number, such as S2.4. where: the place in docs/reference/protocol.md or a decision. d61: the
    section of D6.1 that demands it; empty for a rule of Swarmwright's extensions. needs: rules that must hold
    to try this one. seconds: its time limit, without episodes.
    """

    id: str
    sentence: str
    where: str
    fix: str
    d61: str
    needs: tuple[str, ...]
    seconds: float
    check: Check = field(repr=False)

    @property
    def source(self) -> str:
        """The rule's origin and section, such as `D6.1, 6.2 Control message, Schema 4`."""
        return f"D6.1, {self.d61}" if self.d61 else f"Swarmwright, {self.where}"

    @property
    def owner(self) -> str:
        """The rule's origin: one of OWNERS."""
        return owner(self.source)

    @property
    def group(self) -> str:
        """Group of the rule: the part of its id before the dot."""
        return self.id.partition(".")[0]


def owner(source: str) -> str:
    """Return a rule's origin from its source."""
    return source.partition(",")[0]


class Rules:
    """The rules for one kind of peer, in the order in which they are tried."""

    def __init__(self, side: Side, groups: dict[str, str]) -> None:
        self.side = side
        self.groups = groups
        self._rules: dict[str, Rule] = {}

    def rule(
        self,
        number: str,
        sentence: str,
        *,
        where: str,
        fix: str,
        d61: str = "",
        needs: Sequence[str] = (),
        seconds: float = 20.0,
    ) -> Callable[[Check], Check]:
        """Register a function as a rule."""

        def register(check: Check) -> Check:
            assert number not in self._rules, number
            assert number.partition(".")[0] in self.groups, number
            unmet = [need for need in needs if need not in self._rules]
            assert not unmet, f"{number} needs {unmet}, which come later or not at all"
            self._rules[number] = Rule(number, sentence, where, fix, d61, tuple(needs), seconds, check)
            return check

        return register

    def __iter__(self) -> Iterator[Rule]:
        """Iterate over the rules in order."""
        return iter(self._rules.values())

    def __len__(self) -> int:
        """Return the number of rules."""
        return len(self._rules)

    def __getitem__(self, number: str) -> Rule:
        """Return the rule with an id."""
        return self._rules[number]

    def needed(self, rules: Sequence[Rule]) -> set[str]:
        """Return the ids of all rules that these rules need."""
        ids: set[str] = set()
        pending = [need for rule in rules for need in rule.needs]
        while pending:
            need = pending.pop()
            if need not in ids:
                ids.add(need)
                pending += self[need].needs
        return ids

    def select(self, requested: Sequence[str] = (), profile: Profile = "all") -> list[Rule]:
        """Return the rules with these ids or groups; `-S7` excludes. Default: all.

        profile: `d6.1` selects only rules that D6.1 demands.

        Raises InputError for an unknown rule, or if no rule is left.
        """
        names = [name.strip() for text in requested for name in text.split(",") if name.strip()]
        available = [*self.groups, *self._rules]
        for name in names:
            bare = name.removeprefix("-")
            if bare not in available:
                hint = did_you_mean(bare, available)
                raise InputError(f"--rules: there is no rule {bare!r}{hint or ';'} --list shows them")
        included = {name for name in names if not name.startswith("-")}
        excluded = {name[1:] for name in names if name.startswith("-")}
        selected = [
            rule
            for rule in self._rules.values()
            if (not included or {rule.id, rule.group} & included) and not {rule.id, rule.group} & excluded
        ]
        result = [rule for rule in selected if profile == "all" or rule.d61]
        if selected and not result:
            raise InputError(
                f"--profile {profile}: {', '.join(rule.id for rule in selected)} are not rules of D6.1; "
                "--list shows the source of each rule"
            )
        return result
