"""The reference page of the rules, generated from the rules."""

from swarmwright.conformance.optimizer import RULES as OPTIMIZER
from swarmwright.conformance.rules import Rules
from swarmwright.conformance.server import RULES as SERVER

INTRODUCTION = """\
# Rules of the conformance kit

<!-- Made by `python -m swarmwright.conformance._reference`; change the rules in the code, not here. -->

The rules that `swarmwright conformance` tries, and how to fix a violation;
[how to use it](../how-to/peers.md). `--profile d6.1` tries only those that name a section of D6.1.
Descriptions without a file are sections of [the protocol](protocol.md). Decisions are
[002](../decisions/002-arithmetic.md) on arithmetic, [003](../decisions/003-mqtt-connection.md) on connections
and [023](../decisions/023-control-messages-to-one-server.md). Where D6.1 is open, see
[our choices](d6.1.md).

A rule is skipped if its extension is not announced, or if a rule that it needs is broken (`--list --json`
prints these). Rules on presence, failure messages and tools that name themselves (S6.7 to S6.15, S7.2 to
S7.4, S7.6, S11.3, S16) are skipped where
[nothing that the server does requires them](protocol.md#what-an-announcement-requires).
"""
TITLES = {"server": "Simulation servers", "optimizer": "Optimization tools"}
SIDES = (SERVER, OPTIMIZER)


def reference() -> str:
    """Return the reference page as Markdown."""
    return "\n".join([INTRODUCTION, *map(_format_side, SIDES)])


def _format_side(rules: Rules) -> str:
    parts = [f"## {TITLES[rules.side]}\n"]
    for group, title in rules.groups.items():
        parts += [
            f"### {group} {title}\n",
            "| | rule | fix | described in |",
            "|---|---|---|---|",
        ]
        for rule in rules:
            if rule.group == group:
                where = rule.where.replace("protocol.md, ", "")
                where = f"{where}; D6.1, {rule.d61}" if rule.d61 else where
                cells = (rule.id, rule.sentence, rule.fix, where)
                parts.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |")
        parts.append("")
    return "\n".join(parts)


if __name__ == "__main__":
    print(reference(), end="")
