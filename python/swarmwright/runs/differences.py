"""The first difference between two runs."""

from itertools import zip_longest
from typing import TYPE_CHECKING

from swarmwright.runs.export import csv_lines
from swarmwright.runs.store.verification import verify

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def first_difference(one: "Run", other: "Run") -> str | None:
    """Return in words where the records of two runs differ first; None when they are the same bytes."""
    empty = [run for run in (one, other) if not run.generations]
    if len(empty) == 1:
        return f"{empty[0].path} has no finished generation"
    if _begin_alike(one, other):
        return _ends(one, other, min(one.evaluations, other.evaluations))
    lines = zip_longest(csv_lines(one._store), csv_lines(other._store))
    columns: list[str] = []
    for number, (first, second) in enumerate(lines):
        if first == second:
            columns = columns or (first or "").rstrip().split(",")
            continue
        if first is None or second is None:
            return _ends(one, other, number - 1)
        if number == 0:
            return "they have other columns: another number of episodes, metrics or genes"
        cells = zip(columns, first.rstrip().split(","), second.rstrip().split(","), strict=True)
        name, before, after = next(cell for cell in cells if cell[1] != cell[2])
        row = first.split(",", 2)
        return (
            f"in generation {row[0]}, candidate {row[1]} (evaluation {number - 1}), {name} is {before} in "
            f"{one.path} and {after} in {other.path}"
        )
    return None


def _begin_alike(one: "Run", other: "Run") -> bool:
    """Return whether one of two undamaged runs is the beginning of the other, by their digests.

    To compute these is much faster than to compare the records. Names of metrics are not part of them.
    Records may be the same although digests differ, since formats of stores differ in what they write.
    """
    last = min(one.generations, other.generations) - 1
    return (
        last >= 0
        and one._store.metrics == other._store.metrics
        and one._store.digest(last) == other._store.digest(last)
        and not any(verify(run.path).problems for run in (one, other))
    )


def _ends(one: "Run", other: "Run", count: int) -> str | None:
    """Return in words which of two runs with the same first evaluations has no more; None where both end."""
    if one.evaluations == other.evaluations:
        return None
    shorter, longer = sorted((one, other), key=lambda run: run.evaluations)
    return f"{shorter.path} ends after {count} evaluations, {longer.path} goes on"
