"""The first difference between two runs."""

from itertools import zip_longest
from typing import TYPE_CHECKING

from swarmwright.runs.export import csv_lines
from swarmwright.runs.store.verification import verify

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def find_first_difference(run: "Run", other: "Run") -> str | None:
    """Describe the first difference between the records of two runs; None if they are identical."""
    empty = [each for each in (run, other) if not each.generations]
    if len(empty) == 1:
        return f"{empty[0].path} has no finished generation"
    if _begin_equally(run, other):
        return _describe_end(run, other, min(run.evaluations, other.evaluations))
    lines = zip_longest(csv_lines(run._store), csv_lines(other._store))
    columns: list[str] = []
    for number, (first, second) in enumerate(lines):
        if first == second:
            columns = columns or (first or "").rstrip().split(",")
            continue
        if first is None or second is None:
            return _describe_end(run, other, number - 1)
        if number == 0:
            return "they have different columns: another number of episodes, metrics or genes"
        cells = zip(columns, first.rstrip().split(","), second.rstrip().split(","), strict=True)
        name, before, after = next(cell for cell in cells if cell[1] != cell[2])
        row = first.split(",", 2)
        return (
            f"in generation {row[0]}, candidate {row[1]} (evaluation {number - 1}), {name} is {before} in "
            f"{run.path} and {after} in {other.path}"
        )
    return None


def _begin_equally(run: "Run", other: "Run") -> bool:
    """Return whether one of two undamaged runs is the beginning of the other, judged by their digests.

    Comparing digests is much faster than comparing records. They do not include the names of metrics. Equal
    records may have different digests if their stores have different formats.
    """
    last = min(run.generations, other.generations) - 1
    return (
        last >= 0
        and run._store.metrics == other._store.metrics
        and run._store.digest(last) == other._store.digest(last)
        and not any(verify(each.path).problems for each in (run, other))
    )


def _describe_end(run: "Run", other: "Run", count: int) -> str | None:
    """Describe which of two runs with equal first evaluations is shorter; None if they have equal lengths."""
    if run.evaluations == other.evaluations:
        return None
    shorter, longer = sorted((run, other), key=lambda each: each.evaluations)
    return f"{shorter.path} ends after {count} evaluations, but {longer.path} continues"
