"""The reference page of the rules, made of the rules themselves."""

from swarmwright.conformance.optimizer import RULES as OPTIMIZER
from swarmwright.conformance.rules import Rules
from swarmwright.conformance.server import RULES as SERVER

INTRODUCTION = """\
# Rules of the conformance kit

<!-- Made by `python -m swarmwright.conformance._reference`; change the rules in the code, not here. -->

What `swarmwright conformance` tries, and what to do about a rule that is broken;
[how to use it](../how-to/peers.md). A rule is D6.1's, with the section that demands it, and
`--profile d6.1` tries it; or it is Swarmwright's. All are described in [the protocol](protocol.md), its
[schemas](../../protocol/README.md), or in a decision, [002](../decisions/002-arithmetic.md) on arithmetic,
[003](../decisions/003-mqtt-connection.md) on connections. [What D6.1 leaves open](d6.1.md), and what we
chose, is described on another page. A rule is not tried when one that it needs is broken. Rules that do not
apply to a server are skipped, with the reason: those on an extension where it is not announced, and those on
presence, failure messages and tools that name themselves (S6.7 to S6.15, S7.2 to S7.4, S7.6, S11.3, S16)
where [nothing that the server does requires them](protocol.md#what-an-announcement-requires).
"""
TITLES = {"server": "Simulation servers", "optimizer": "Optimization tools"}
SIDES = (SERVER, OPTIMIZER)


def reference() -> str:
    """The page, Markdown."""
    return "\n".join([INTRODUCTION, *map(_side, SIDES)])


def _side(rules: Rules) -> str:
    parts = [f"## {TITLES[rules.side]}\n"]
    for group, title in rules.groups.items():
        parts += [
            f"### {group} {title}\n",
            "| | rule | origin | described in | fix | needs |",
            "|---|---|---|---|---|---|",
        ]
        for rule in rules:
            if rule.group == group:
                whose = rule.source if rule.d61 else rule.owner
                cells = (rule.id, rule.sentence, whose, rule.where, rule.fix, ", ".join(rule.needs))
                parts.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |")
        parts.append("")
    return "\n".join(parts)


if __name__ == "__main__":
    print(reference(), end="")
