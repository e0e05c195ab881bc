"""A comparison in words and as plain values."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swarmwright.core.formatting import p_value
from swarmwright.core.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Pair

_PAIRS = 15
"""Most pairs that are printed; the plain values have all."""


def table(comparison: "Comparison") -> str:
    """Return the groups as a table, then the tests, then notes."""
    head = ["group", "runs", "evaluations", "median", "quartiles", "worst", "best"]
    rows = [head]
    for one in comparison.groups:
        shortest, longest = one.evaluations
        span = f"{shortest:,}" if shortest == longest else f"{shortest:,} to {longest:,}"
        low, high = one.quartiles
        rows.append(
            [
                one.label, str(len(one.runs)), span, number(one.median), f"{number(low)} to {number(high)}",
                number(one.quantile(0.0)), number(one.quantile(1.0)),
            ]
        )  # fmt: skip
    lines = columns(rows)
    if comparison.kruskal is not None:
        test = comparison.kruskal
        lines += ["", f"All groups: Kruskal-Wallis H {number(test.h)}, p {p_value(test.p)}"]
    if comparison.pairs:
        lines += ["", *_pairs(comparison.pairs)]
    if comparison.held_out:
        lines = ["Mean fitness of each run's best candidate on held-out seeds:", "", *lines]
    if comparison.indicator.heading:
        lines = [one_line(comparison.indicator.heading), "", *lines]
    return "\n".join([*lines, *(f"Note: {one_line(note)}." for note in comparison.notes)])


def _pairs(pairs: Sequence["Pair"]) -> list[str]:
    several = len(pairs) > 1
    head = ["first", "against second", "A12", "effect", "difference", "95 % interval", "U", "p"]
    rows = [head + ["p (Holm)"] * several]
    for pair in sorted(pairs, key=lambda one: one.difference.p)[:_PAIRS] if len(pairs) > _PAIRS else pairs:
        found = pair.difference
        rows.append(
            [
                pair.first.label, pair.second.label, f"{found.effect:.2f}", found.magnitude or "too few runs",
                number(found.shift), _interval(found.interval), f"{found.u:g}", p_value(found.p),
            ]
            + [p_value(pair.p_holm)] * several
        )  # fmt: skip
    hidden = len(pairs) - len(rows) + 1
    return columns(rows) + ([f"and {hidden} pairs with larger p; --json has all"] if hidden else [])


def _interval(interval: tuple[float, float] | None) -> str:
    return "none, too few runs" if interval is None else f"{number(interval[0])} to {number(interval[1])}"


def number(value: float) -> str:
    """Return a number in four significant digits."""
    return "failed" if value == float("-inf") else f"{value + 0.0:.4g}"  # no -0


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines with aligned columns: words to the left, the rest to the right."""
    rows = [[one_line(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    # A column whose cells all begin with a letter holds words.
    words = [all(row[i][:1].isalpha() for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if is_words else cell.rjust(width)
            for cell, width, is_words in zip(row, widths, words, strict=True)
        ).rstrip()
        for row in rows
    ]


def to_mapping(comparison: "Comparison") -> dict[str, Any]:
    """Return a comparison as plain values; NaN and infinities are left as they are."""
    return {
        "at": comparison.at,
        "held_out": comparison.held_out,
        **comparison.indicator.to_mapping(),
        "groups": [
            {
                "label": one.label,
                "differs": one.differs,
                "runs": [
                    {
                        "run": str(run.path), "seed": run.experiment.seed, "evaluations": count,
                        comparison.indicator.by: float(value),
                    }
                    for run, value, count in zip(one.runs, one.final, one.counts, strict=True)
                ],
                "median": one.median,
                "quartiles": list(one.quartiles),
                "worst": one.quantile(0.0),
                "best": one.quantile(1.0),
            }
            for one in comparison.groups
        ],
        "kruskal_wallis": None
        if comparison.kruskal is None
        else {"h": comparison.kruskal.h, "p": comparison.kruskal.p},
        "pairs": [
            {
                "first": pair.first.label,
                "second": pair.second.label,
                "u": pair.difference.u,
                "p": pair.difference.p,
                "p_holm": pair.p_holm,
                "a12": pair.difference.effect,
                "magnitude": pair.difference.magnitude or None,
                "difference": pair.difference.shift,
                "interval": list(pair.difference.interval) if pair.difference.interval else None,
            }
            for pair in comparison.pairs
        ],
        "notes": list(comparison.notes),
    }  # fmt: skip
