"""The first difference between two runs."""

from itertools import zip_longest
from typing import TYPE_CHECKING

from swarmwright.runs.export import csv_lines

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def first_difference(one: "Run", other: "Run") -> str | None:
    """Return in words where the records of two runs differ first; None when they are the same bytes."""
    lines = zip_longest(csv_lines(one.store), csv_lines(other.store))
    columns: list[str] = []
    for number, (first, second) in enumerate(lines):
        if first == second:
            columns = columns or (first or "").rstrip().split(",")
            continue
        if first is None or second is None:
            longer, shorter = (other, one) if first is None else (one, other)
            return f"{shorter.path} ends after {number - 1} evaluations, {longer.path} goes on"
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
