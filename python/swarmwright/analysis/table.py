"""A comparison as text and as plain values."""

import csv
import io
import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from swarmwright.analysis.episodes import fitness_at
from swarmwright.analysis.groups import flatten_experiment
from swarmwright.common import html
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.common.formatting import format_p_value
from swarmwright.common.untrusted import escape_line
from swarmwright.methods import MethodOptions
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings import RankingOptions

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Group, Pair
    from swarmwright.analysis.significance import Difference, Kruskal
    from swarmwright.runs.validation import Validation


_PAIRS = 15
"""Largest number of printed pairs; the plain values have all."""
_METHODS = {"exact": "exact", "permutations": "of 100,000 permutations", "chi-square": "chi-square"}
"""Descriptions of how the p-value of the Kruskal-Wallis test was computed."""


_UNKNOWN = "group not known"
"""Label of runs that cannot be read."""


class Labelled(Protocol):
    """A group in a comparison."""

    @property
    def label(self) -> str:
        """Description of what distinguishes the group."""


class Tested(Protocol):
    """Two groups and the difference between them."""

    @property
    def first(self) -> Labelled:
        """The first group."""

    @property
    def second(self) -> Labelled:
        """The second group."""

    @property
    def difference(self) -> "Difference":
        """Statistics of the first group against the second."""

    @property
    def p_holm(self) -> float:
        """p, corrected for several pairs after Holm."""

    @property
    def magnitude(self) -> str:
        """Effect size in words; empty if `p_holm` is not significant."""


def table(comparison: "Comparison") -> str:
    """Return the groups and tests of each task as a table, then notes."""
    several = len(comparison.tasks) > 1
    lines: list[str] = []
    for task in comparison.tasks:
        if several:
            lines += [""] * bool(lines) + [f"Task: {escape_line(task.label)}", ""]
        lines += columns(_group_rows(task.groups, comparison))
        if task.kruskal is not None:
            title = "All groups of the task" if several else "All groups"
            lines += ["", f"{title}: {kruskal_words(task.kruskal)}"]
        if task.pairs:
            lines += ["", *pairs_table(task.pairs)]
    lacking = lacking_rows(comparison) if several else []
    if lacking:
        lines += ["", *columns([["group", "runs", "left out"], *lacking])]
    if several:
        lines.append("")
    if comparison.held_out:
        lines = ["Mean fitness of each run's best candidate on held-out seeds:", "", *lines]
    heading = comparison.heading or comparison.indicator.heading
    if heading:
        lines = [escape_line(heading), "", *lines]
    return "\n".join([*lines, *(f"Note: {escape_line(note)}." for note in comparison.notes)])


def html_of(comparison: "Comparison") -> str:
    """Return the content of `table` as HTML, for notebooks."""
    several = len(comparison.tasks) > 1
    heading = (comparison.heading or comparison.indicator.heading).removesuffix(":")
    if comparison.held_out:
        heading = "Mean fitness of each run's best candidate on held-out seeds"
    parts = [html.facts(f"Comparison of {len(comparison.groups)} groups. {heading}", [])]
    for task in comparison.tasks:
        head, *rows = _group_rows(task.groups, comparison)
        parts.append(html.facts(f"Task: {task.label}", []) if several else "")
        parts.append(html.table(head, rows))
        if task.kruskal is not None:
            parts.append(html.facts("", [("All groups", kruskal_words(task.kruskal))]))
        if task.pairs:
            head, *rows = _pair_rows(task.pairs)
            parts.append(html.table(head, rows))
            hidden = len(task.pairs) - len(rows)
            parts.append(html.facts(f"and {hidden} pairs with larger p", []) if hidden else "")
    lacking = lacking_rows(comparison) if several else []
    parts.append(html.table(["group", "runs", "left out"], lacking) if lacking else "")
    notes = [("Note", f"{escape_line(note)}.") for note in comparison.notes]
    return "".join([*parts, html.facts("", notes) if notes else ""])


def _group_rows(groups: Sequence["Group"], comparison: "Comparison") -> list[list[str]]:
    """Return the rows of groups below a heading; with one task, including groups without a counted run."""
    # If each evaluation is one episode, or nothing failed, the column has no information.
    episodes = any(group.episodes != group.counts for group in groups)
    failed = any(any(group.failed) for group in groups)
    lost = comparison.held_out and any(any(group.held_out_failed) for group in groups)
    lacking = bool(comparison.left_out)
    rows = [
        [
            "group", "runs", *["left out"] * lacking, "evaluations", *["failed"] * failed,
            *["episodes"] * episodes, *["held-out failed"] * lost, "median", "quartiles", "worst", "best",
        ]
    ]  # fmt: skip
    for group in groups:
        low, high = group.quartiles
        rows.append(
            [
                group.label, str(len(group.runs)), *[str(len(group.left_out))] * lacking,
                span(group.counts), *[span(group.failed)] * failed, *[span(group.episodes)] * episodes,
                *[span(group.held_out_failed)] * lost, number(group.median),
                f"{number(low)} to {number(high)}", number(group.quantile(0.0)), number(group.quantile(1.0)),
            ]
        )  # fmt: skip
    if len(comparison.tasks) == 1:
        rows += [[*row, *[""] * (len(rows[0]) - len(row))] for row in lacking_rows(comparison)]
    return rows


def lacking_rows(comparison: "Comparison") -> list[list[str]]:
    """Return label, 0 and the number of excluded runs for each group without a counted run."""
    counted_paths = {run.path for group in comparison.groups for run in group.left_out}
    counts: dict[str, int] = {}
    for run in comparison.left_out:
        if run.path not in counted_paths:
            label = run.label or _UNKNOWN
            counts[label] = counts.get(label, 0) + 1
    return [[comparison.labels.get(label, label), "0", str(count)] for label, count in counts.items()]


def span(counts: Sequence[int]) -> str:
    """Format the smallest and the largest of some counts, or a single number if they are equal."""
    least, most = min(counts), max(counts)
    return f"{least:,}" if least == most else f"{least:,} to {most:,}"


def kruskal_words(test: "Kruskal") -> str:
    """Describe a Kruskal-Wallis test of several groups."""
    return f"Kruskal-Wallis H {number(test.h)}, p {format_p_value(test.p)} ({_METHODS[test.method]})"


def pairs_table(pairs: Sequence[Tested], *, quantity: str = "") -> list[str]:
    """Return lines with the tests of pairs; with many pairs, those with the smallest p.

    quantity: compared quantity, for the heading of the effect size.
    """
    rows = _pair_rows(pairs, quantity=quantity)
    hidden = len(pairs) - len(rows) + 1
    return columns(rows) + ([f"and {hidden} pairs with larger p; --json has all"] if hidden else [])


def _pair_rows(pairs: Sequence[Tested], *, quantity: str = "") -> list[list[str]]:
    several = len(pairs) > 1
    head = ["first", "against second", f"A12{quantity}", "effect", "difference", "95 % interval", "U", "p"]
    rows = [head + ["p (Holm)"] * several]
    for pair in (
        sorted(pairs, key=lambda pair_of_groups: pair_of_groups.difference.p)[:_PAIRS]
        if len(pairs) > _PAIRS
        else pairs
    ):
        difference = pair.difference
        rows.append(
            [
                pair.first.label, pair.second.label, f"{difference.effect:.2f}", effect_words(pair),
                number(difference.shift), _interval(difference.interval), f"{difference.u:g}",
                format_p_value(difference.p),
            ]
            + [format_p_value(pair.p_holm)] * several
        )  # fmt: skip
    return rows


def effect_words(pair: Tested) -> str:
    """Describe the effect size, or why there is none."""
    if pair.difference.interval is None:
        return "too few runs"
    return pair.magnitude or "not significant"


def _interval(interval: tuple[float, float] | None) -> str:
    return "none, too few runs" if interval is None else f"{number(interval[0])} to {number(interval[1])}"


def number(value: float) -> str:
    """Format a number with four significant digits."""
    return "failed" if value == float("-inf") else f"{value + 0.0:.4g}"  # no -0


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines with aligned columns: text to the left, numbers to the right."""
    rows = [[escape_line(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    # A column whose cells all begin with a letter is text.
    words = [all(row[i][:1].isalpha() for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if is_words else cell.rjust(width)
            for cell, width, is_words in zip(row, widths, words, strict=True)
        ).rstrip()
        for row in rows
    ]


def to_mapping(comparison: "Comparison") -> dict[str, Any]:
    """Return a comparison as plain values; NaN and infinities are not converted."""
    return {
        "at": comparison.at,
        "at_episodes": comparison.at_episodes,
        "held_out": comparison.held_out,
        **comparison.indicator.to_mapping(),
        "groups": [
            {
                "label": group.label,
                "differs": group.differs,
                "runs": [
                    {
                        "run": str(run.path), "seed": run.experiment.seed, "evaluations": count,
                        "episodes": episodes, "failed": failed, "held_out_failed": lost,
                        comparison.indicator.by: float(value),
                    }
                    for run, value, count, episodes, failed, lost in zip(
                        group.runs, group.final, group.counts, group.episodes, group.failed,
                        group.held_out_failed, strict=True,
                    )
                ],
                "left_out": len(group.left_out),
                "median": group.median,
                "quartiles": list(group.quartiles),
                "worst": group.quantile(0.0),
                "best": group.quantile(1.0),
            }
            for group in comparison.groups
        ],
        "kruskal_wallis": None if comparison.kruskal is None else vars(comparison.kruskal),
        "tasks": [
            {
                "label": task.label,
                "differs": task.differs,
                "groups": [group.label for group in task.groups],
                "kruskal_wallis": None if task.kruskal is None else vars(task.kruskal),
            }
            for task in comparison.tasks
        ],
        "pairs": [pair_mapping(pair) for pair in comparison.pairs],
        "left_out": [missing_run.to_mapping() for missing_run in comparison.left_out],
        "notes": list(comparison.notes),
    }  # fmt: skip


def pair_mapping(pair: Tested) -> dict[str, Any]:
    """Return the test of a pair as plain values."""
    difference = pair.difference
    return {
        "first": pair.first.label,
        "second": pair.second.label,
        "u": difference.u,
        "p": difference.p,
        "p_holm": pair.p_holm,
        "a12": difference.effect,
        "magnitude": pair.magnitude or None,
        "difference": difference.shift,
        "interval": list(difference.interval) if difference.interval else None,
    }


_OF_ALL_KINDS = {
    "method": frozenset(MethodOptions.model_fields),
    "ranking": frozenset(RankingOptions.model_fields),
}
"""Options that have the same meaning for all kinds."""


def option_columns(rows: Sequence[tuple[Mapping[str, Any], Collection[str]]]) -> list[dict[str, Any]]:
    """Return the columns of each row, the same for all rows; None for keys that a row does not have.

    If there are several kinds, an option has a column for each kind in which it differs, since
    `method.cma_es.step` is a different quantity from `method.evostick.step`.

    rows: the experiment of each row by dotted keys, and which of these keys differ for it.
    """
    columns: dict[str, None] = {}
    rows_of_columns: list[dict[str, Any]] = [{} for _ in rows]
    for key in dict.fromkeys(key for _, keys in rows for key in keys):
        section, _, option = key.partition(".")
        kinds = {str(values.get(f"{section}.kind")) for values, _ in rows if key in values}
        of_kinds = section in REGISTRIES and len(kinds) > 1 and not _is_common_option(section, option)
        for row, (values, keys) in zip(rows_of_columns, rows, strict=True):
            if not of_kinds:
                columns[key] = None
                row[key] = values.get(key)
            elif key in keys:
                column = f"{section}.{values[f'{section}.kind']}.{option}"
                columns[column] = None
                row[column] = values[key]
    return [{column: row.get(column) for column in columns} for row in rows_of_columns]


def _is_common_option(section: str, option: str) -> bool:
    return option == "kind" or option in _OF_ALL_KINDS.get(section, ())


CSV, LATEX = ".csv", ".tex"
_HELD_OUT = tuple(
    f"held_out_{name}" for name in ("fitness", "episodes", "failed", "standard_error", "low", "high")
)
"""Columns of mean fitness of a run's best candidate on held-out seeds; low to high: 95 % interval."""
_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}  # fmt: skip


def check(path: Path, *endings: str) -> None:
    """Raise InputError unless a table with one of these suffixes can be written to a path."""
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: this table ends with {' or '.join(endings)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder '{path.parent}'; create it first")


def write(comparison: "Comparison", path: Path) -> Path:
    """Write a comparison as a table in the format of the file's suffix; return the path.

    Raises InputError for another suffix or a file that cannot be written.
    """
    check(path, CSV, LATEX)
    write_text(
        path, csv_text(comparison, path.parent) if path.suffix.lower() == CSV else latex_text(comparison)
    )
    return path


def csv_text(comparison: "Comparison", folder: Path) -> str:
    """Return CSV text with a row for each run; excluded runs come last and have no values.

    Columns: task (empty for a single task), group, run (its folder, relative to that of the table), seed,
    left_out (the reason of an excluded run, otherwise empty), counted evaluations and episodes, the number of
    failed ones among these evaluations, the best recorded fitness of these, the compared indicator if any,
    fitness on held-out seeds, seconds of the whole run, SHA-256 of its record, then the keys that differ
    between the groups, see `option_columns`; experiment.fitness where fitness is one of them. nan: no
    candidate could be evaluated; empty: unknown.

    folder: folder of the table.
    """
    tasks = {group.label: task.label for task in comparison.tasks for group in task.groups}
    differing = option_columns(
        [
            ({**flatten_experiment(group.runs[0]), **group.differs}, group.differs)
            for group in comparison.groups
        ]
    )
    by = comparison.indicator.by
    best = by == "fitness" and not comparison.held_out
    at_end = comparison.at is None and comparison.at_episodes is None
    rows: list[dict[str, Any]] = []
    for group, keys in zip(comparison.groups, differing, strict=True):
        for run, value, count, episodes, failed in zip(
            group.runs, group.final.tolist(), group.counts, group.episodes, group.failed, strict=True
        ):
            row = {
                "task": tasks[group.label], "group": group.label,
                "run": os.path.relpath(run.path.resolve(), folder.resolve()),
                "seed": run.experiment.seed, "left_out": None, "evaluations": count, "episodes": episodes,
                "failed": failed,
                "fitness": value if best else fitness_at(run, comparison.at)[0],
            }  # fmt: skip
            if by != "fitness":
                row[by] = value
            # The validated candidate is the best one at the run's end.
            row |= _make_held_out_columns(run.validation if at_end else None)
            row |= {"seconds": run.seconds, "record_sha256": run.digest}
            rows.append(row | {f"experiment.{key}" if key in row else key: keys[key] for key in keys})
    for lacking in comparison.left_out:
        label = comparison.labels.get(lacking.label, lacking.label)
        rows.append(
            {
                "task": tasks.get(label), "group": label,
                "run": os.path.relpath(lacking.path.resolve(), folder.resolve()),
                "seed": lacking.seed, "left_out": lacking.reason,
            }
        )  # fmt: skip
    heading = list(rows[0])
    for row in rows:
        if row["run"][:1] in _FORMULA_SIGNS:
            row["run"] = f"./{row['run']}"  # the same folder
    return format_csv(heading, ([row.get(name) for name in heading] for row in rows))


_FORMULA_SIGNS = ("=", "+", "-", "@")


def format_csv(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV; a text gets an apostrophe where a spreadsheet would take it for a formula."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    for row in (heading, *rows):
        table.writerow([_escape_csv(cell) if isinstance(cell, str) else cell for cell in row])
    return text.getvalue()


def write_csv(path: str | os.PathLike[str], heading: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write rows as CSV, see `format_csv`.

    Raises InputError for a suffix other than .csv, and if the file cannot be written.
    """
    check(Path(path), CSV)
    write_text(path, format_csv(heading, rows))


def _escape_csv(text: str) -> str:
    """Return a text in a single line, with an apostrophe where a spreadsheet would take it for a formula."""
    escaped = escape_line(text)
    if not escaped.startswith(_FORMULA_SIGNS):
        return escaped
    try:
        float(escaped)
    except ValueError:
        return f"'{escaped}"
    return escaped


def _make_held_out_columns(validation: "Validation | None") -> dict[str, float | None]:
    """Return the columns of fitness on held-out seeds; empty if unknown."""
    if validation is None:
        return dict.fromkeys(_HELD_OUT)
    best = validation.best
    fitness = best.fitness
    values = (
        fitness.mean, len(best.seeds), best.failed, fitness.standard_error, fitness.low, fitness.high
    )  # fmt: skip
    return dict(zip(_HELD_OUT, values, strict=True))


def latex_text(comparison: "Comparison") -> str:
    """Return the groups and the tests of each task as `tabular` environments, for the package booktabs."""
    lines = [r"% needs \usepackage{booktabs}"]
    lines.append(f"% {_describe_quantity(comparison)}, {_when(comparison)}")
    for task in comparison.tasks:
        if task.label:
            lines.append(f"% task: {escape_line(task.label)}")
        if task.kruskal is not None:
            lines.append(f"% {kruskal_words(task.kruskal)}")
        lines += _groups(task.groups, comparison)
        if task.pairs:
            lines += _pairs(task.pairs)
    lines += [f"% {escape_line(note)}" for note in comparison.notes]
    return "\n".join(lines) + "\n"


def _describe_quantity(comparison: "Comparison") -> str:
    """Describe the compared quantity."""
    if comparison.held_out:
        return "mean fitness of each run's best candidate on held-out seeds"
    if comparison.indicator.by == "fitness":
        return "best recorded fitness of each run"
    return escape_line(comparison.indicator.heading or comparison.indicator.words).rstrip(":.")


def _when(comparison: "Comparison") -> str:
    if comparison.at_episodes is not None:
        return f"after {comparison.at_episodes:,} episodes"
    return "at its end" if comparison.at is None else f"after {comparison.at:,} evaluations"


def _groups(groups: Sequence["Group"], comparison: "Comparison") -> list[str]:
    failed = any(any(group.failed) for group in groups)
    lost = comparison.held_out and any(any(group.held_out_failed) for group in groups)
    lacking = bool(comparison.left_out)
    rows = [
        [
            group.label, str(len(group.runs)), *[str(len(group.left_out))] * lacking, span(group.counts),
            span(group.episodes), *[span(group.failed)] * failed, *[span(group.held_out_failed)] * lost,
            number(group.median), *map(number, group.quartiles), number(group.quantile(0.0)),
            number(group.quantile(1.0)),
        ]
        for group in groups
    ]  # fmt: skip
    head = [
        "group", "runs", *["left out"] * lacking, "evaluations", "episodes", *["failed"] * failed,
        *["held-out failed"] * lost, "median", "lower quartile", "upper quartile", "worst", "best",
    ]  # fmt: skip
    if groups == comparison.tasks[-1].groups:  # below the last table, since their task is unknown
        rows += [[*row, *[""] * (len(head) - len(row))] for row in lacking_rows(comparison)]
    return _tabular(head, rows, words=1)


def _pairs(pairs: Sequence["Pair"]) -> list[str]:
    several = len(pairs) > 1
    rows = []
    for pair in pairs:
        difference = pair.difference
        low, high = ("", "") if difference.interval is None else map(number, difference.interval)
        rows.append(
            [
                pair.first.label, pair.second.label, effect_words(pair), f"{difference.effect:.2f}",
                number(difference.shift), low, high, f"{difference.u:g}", format_p_value(difference.p),
                *([format_p_value(pair.p_holm)] if several else []),
            ]
        )  # fmt: skip
    head = ["first", "second", "effect", "A12", "difference", "95 % from", "95 % to", "U", "p", "p (Holm)"]
    return _tabular(head[: len(head) if several else -1], rows, words=3)


def _tabular(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int) -> list[str]:
    """Return a LaTeX table. words: number of leading text columns; the others hold numbers."""
    # A bracket or an asterisk at the beginning of a row would belong to the end of the row before.
    body = [
        "{}" * row[0].startswith(("[", "*")) + " & ".join(map(_escape_latex, row)) + r" \\"
        for row in (head, *rows)
    ]
    return [
        rf"\begin{{tabular}}{{{'l' * words}{'r' * (len(head) - words)}}}",
        r"\toprule", body[0], r"\midrule", *body[1:], r"\bottomrule",
        r"\end{tabular}",
    ]  # fmt: skip


def _escape_latex(text: str) -> str:
    return re.sub(r"[\\~^<>&%$#_{}]", lambda match: _SPECIAL[match[0]], escape_line(text))
