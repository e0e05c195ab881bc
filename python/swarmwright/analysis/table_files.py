"""A comparison as files: every run as CSV, groups and tests as LaTeX."""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.analysis.table import kruskal_words, number
from swarmwright.core.errors import InputError
from swarmwright.core.files import write_text
from swarmwright.core.formatting import p_value
from swarmwright.core.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Group, Pair

CSV, LATEX = ".csv", ".tex"
_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}  # fmt: skip


def check(path: Path, *endings: str) -> None:
    """Raise InputError unless a table with one of these endings can be written there."""
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: this table ends with {' or '.join(endings)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder '{path.parent}'; create it first")


def write(comparison: "Comparison", path: Path) -> Path:
    """Write a comparison as a table by the ending of its file; return the path.

    Raises InputError for another ending or a file that cannot be written.
    """
    check(path, CSV, LATEX)
    write_text(path, (csv_text if path.suffix.lower() == CSV else latex_text)(comparison))
    return path


def csv_text(comparison: "Comparison") -> str:
    """Return a row for each run.

    Columns: task (empty where there is one), group, run, seed, evaluations, what is compared (fitness,
    held_out_fitness, hypervolume, ..; nan where no candidate could be evaluated), then the keys that differ
    between the groups.
    """
    tasks = {one.label: task.label for task in comparison.tasks for one in task.groups}
    keys = list(dict.fromkeys(key for one in comparison.groups for key in one.differs))
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    what = "held_out_fitness" if comparison.held_out else comparison.indicator.by
    table.writerow(["task", "group", "run", "seed", "evaluations", what, *keys])
    for one in comparison.groups:
        differing = [one.differs.get(key) for key in keys]
        for run, value, count in zip(one.runs, one.final.tolist(), one.counts, strict=True):
            first = (tasks[one.label], one.label, run.path, run.experiment.seed, count, value)
            table.writerow([*first, *differing])
    return text.getvalue()


def latex_text(comparison: "Comparison") -> str:
    """Return the groups and the tests of each task as `tabular` environments, for the package booktabs."""
    lines = [r"% needs \usepackage{booktabs}"]
    lines.append(f"% {_what(comparison)}, {_when(comparison)}")
    for task in comparison.tasks:
        if task.label:
            lines.append(f"% task: {one_line(task.label)}")
        if task.kruskal is not None:
            lines.append(f"% {kruskal_words(task.kruskal)}")
        lines += _groups(task.groups)
        if task.pairs:
            lines += _pairs(task.pairs)
    lines += [f"% {one_line(note)}" for note in comparison.notes]
    return "\n".join(lines) + "\n"


def _what(comparison: "Comparison") -> str:
    """Return what is compared of each run, in words."""
    if comparison.held_out:
        return "mean fitness of each run's best candidate on held-out seeds"
    if comparison.indicator.by == "fitness":
        return "best recorded fitness of each run"
    return one_line(comparison.indicator.heading or comparison.indicator.words).rstrip(":.")


def _when(comparison: "Comparison") -> str:
    return "at its end" if comparison.at is None else f"after {comparison.at:,} evaluations"


def _groups(groups: Sequence["Group"]) -> list[str]:
    rows = [
        [
            one.label, str(len(one.runs)), number(one.median), *map(number, one.quartiles),
            number(one.quantile(0.0)), number(one.quantile(1.0)),
        ]
        for one in groups
    ]  # fmt: skip
    return _tabular(
        ["group", "runs", "median", "lower quartile", "upper quartile", "worst", "best"], rows, words=1
    )


def _pairs(pairs: Sequence["Pair"]) -> list[str]:
    several = len(pairs) > 1
    rows = []
    for pair in pairs:
        found = pair.difference
        low, high = ("", "") if found.interval is None else map(number, found.interval)
        rows.append(
            [
                pair.first.label, pair.second.label, f"{found.effect:.2f}", number(found.shift), low, high,
                f"{found.u:g}", p_value(found.p), *([p_value(pair.p_holm)] if several else []),
            ]
        )  # fmt: skip
    head = ["first", "second", "A12", "difference", "95 % from", "95 % to", "U", "p", "p (Holm)"]
    return _tabular(head[: len(head) if several else -1], rows, words=2)


def _tabular(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int) -> list[str]:
    """Return a table. words: how many columns hold words, the first ones; the others hold numbers."""
    body = [" & ".join(map(_escaped, row)) + r" \\" for row in (head, *rows)]
    return [
        rf"\begin{{tabular}}{{{'l' * words}{'r' * (len(head) - words)}}}",
        r"\toprule", body[0], r"\midrule", *body[1:], r"\bottomrule",
        r"\end{tabular}",
    ]  # fmt: skip


def _escaped(text: str) -> str:
    return re.sub(r"[\\~^<>&%$#_{}]", lambda found: _SPECIAL[found[0]], one_line(text))
