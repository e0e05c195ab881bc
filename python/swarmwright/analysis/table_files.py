"""A comparison as files: every run as CSV, groups and tests as LaTeX."""

import csv
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.analysis.after_evaluations import fitness_at
from swarmwright.analysis.groups import flattened_of
from swarmwright.analysis.option_columns import option_columns
from swarmwright.analysis.table import effect_words, kruskal_words, lacking_rows, number, span
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.common.formatting import p_value
from swarmwright.common.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Group, Pair
    from swarmwright.runs.validation import Validation

CSV, LATEX = ".csv", ".tex"
_HELD_OUT = tuple(
    f"held_out_{name}" for name in ("fitness", "episodes", "failed", "standard_error", "low", "high")
)
"""Columns of the mean fitness of a run's best candidate on held-out seeds; low to high: 95 % interval."""
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
    write_text(
        path, csv_text(comparison, path.parent) if path.suffix.lower() == CSV else latex_text(comparison)
    )
    return path


def csv_text(comparison: "Comparison", folder: Path) -> str:
    """Return a row for each run, last those that do not count, which have no values.

    Columns: task (empty where there is one), group, run (its folder, relative to that of the table), seed,
    left_out (why a run does not count, else empty), evaluations and episodes that count, how many of these
    evaluations failed, the best recorded fitness of these, the indicator that is compared if any, fitness on
    held-out seeds, seconds of the whole run, SHA-256 of its record, then the keys that differ between the
    groups, see `option_columns`. nan: no candidate could be evaluated; empty: not known.

    folder: of the table.
    """
    tasks = {one.label: task.label for task in comparison.tasks for one in task.groups}
    differing = option_columns(
        [({**flattened_of(one.runs[0]), **one.differs}, one.differs) for one in comparison.groups]
    )
    by = comparison.indicator.by
    best = by == "fitness" and not comparison.held_out
    at_end = comparison.at is None and comparison.at_episodes is None
    rows: list[dict[str, Any]] = []
    for one, keys in zip(comparison.groups, differing, strict=True):
        for run, value, count, episodes, failed in zip(
            one.runs, one.final.tolist(), one.counts, one.episodes, one.failed, strict=True
        ):
            row = {
                "task": tasks[one.label], "group": one.label,
                "run": os.path.relpath(run.path.resolve(), folder.resolve()),
                "seed": run.experiment.seed, "left_out": None, "evaluations": count, "episodes": episodes,
                "failed": failed,
                "fitness": value if best else fitness_at(run, comparison.at)[0],
            }  # fmt: skip
            if by != "fitness":
                row[by] = value
            # The candidate that is the best at the run's end was validated.
            row |= _held_out(run.validation if at_end else None)
            rows.append({**row, "seconds": run.seconds, "record_sha256": run.digest, **keys})
    for lacking in comparison.left_out:
        label = comparison.labels.get(lacking.label, lacking.label)
        rows.append(
            {
                "task": tasks.get(label), "group": label,
                "run": os.path.relpath(lacking.path.resolve(), folder.resolve()),
                "seed": lacking.seed, "left_out": lacking.reason,
            }
        )  # fmt: skip
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _held_out(validation: "Validation | None") -> dict[str, float | None]:
    """Return the columns of fitness on held-out seeds, empty where that is not known."""
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
    lines.append(f"% {_compared_value(comparison)}, {_when(comparison)}")
    for task in comparison.tasks:
        if task.label:
            lines.append(f"% task: {one_line(task.label)}")
        if task.kruskal is not None:
            lines.append(f"% {kruskal_words(task.kruskal)}")
        lines += _groups(task.groups, comparison)
        if task.pairs:
            lines += _pairs(task.pairs)
    lines += [f"% {one_line(note)}" for note in comparison.notes]
    return "\n".join(lines) + "\n"


def _compared_value(comparison: "Comparison") -> str:
    """Return what is compared of each run, in words."""
    if comparison.held_out:
        return "mean fitness of each run's best candidate on held-out seeds"
    if comparison.indicator.by == "fitness":
        return "best recorded fitness of each run"
    return one_line(comparison.indicator.heading or comparison.indicator.words).rstrip(":.")


def _when(comparison: "Comparison") -> str:
    if comparison.at_episodes is not None:
        return f"after {comparison.at_episodes:,} episodes"
    return "at its end" if comparison.at is None else f"after {comparison.at:,} evaluations"


def _groups(groups: Sequence["Group"], comparison: "Comparison") -> list[str]:
    failed = any(any(one.failed) for one in groups)
    lost = comparison.held_out and any(any(one.held_out_failed) for one in groups)
    lacking = bool(comparison.left_out)
    rows = [
        [
            one.label, str(len(one.runs)), *[str(len(one.left_out))] * lacking, span(one.counts),
            span(one.episodes), *[span(one.failed)] * failed, *[span(one.held_out_failed)] * lost,
            number(one.median), *map(number, one.quartiles), number(one.quantile(0.0)),
            number(one.quantile(1.0)),
        ]
        for one in groups
    ]  # fmt: skip
    head = [
        "group", "runs", *["left out"] * lacking, "evaluations", "episodes", *["failed"] * failed,
        *["held-out failed"] * lost, "median", "lower quartile", "upper quartile", "worst", "best",
    ]  # fmt: skip
    if groups == comparison.tasks[-1].groups:  # below the last table: their task is not known
        rows += [[*row, *[""] * (len(head) - len(row))] for row in lacking_rows(comparison)]
    return _tabular(head, rows, words=1)


def _pairs(pairs: Sequence["Pair"]) -> list[str]:
    several = len(pairs) > 1
    rows = []
    for pair in pairs:
        found = pair.difference
        low, high = ("", "") if found.interval is None else map(number, found.interval)
        rows.append(
            [
                pair.first.label, pair.second.label, effect_words(pair), f"{found.effect:.2f}",
                number(found.shift), low, high, f"{found.u:g}", p_value(found.p),
                *([p_value(pair.p_holm)] if several else []),
            ]
        )  # fmt: skip
    head = ["first", "second", "effect", "A12", "difference", "95 % from", "95 % to", "U", "p", "p (Holm)"]
    return _tabular(head[: len(head) if several else -1], rows, words=3)


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
