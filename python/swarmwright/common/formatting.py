"""Durations, counts, amounts, p-values, long names and tables as text."""

import math
import re
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from unicodedata import east_asian_width


def format_duration(seconds: float) -> str:
    """Format a duration in seconds: 8.2 s, 3 min 05 s, 2 h 07 min."""
    if not math.isfinite(seconds):
        return "?"
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


def format_rate(per_second: float) -> str:
    """Format a rate as a whole number, or with two digits if it is below 10."""
    return f"{per_second:.0f}" if per_second >= 10 else f"{per_second:.2g}"


def format_count(count: int, noun: str) -> str:
    """Format a count with its noun: 1 generation, 2,000 generations."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def format_amount(value: float) -> str:
    """Format a non-negative amount with two decimals, or two digits if it is small: 12.30, 0.0033."""
    if value == 0 or value >= 0.095:
        return f"{value:.2f}"
    return f"{value:.2g}" if value >= 1e-4 else f"{value:.6f}".rstrip("0").rstrip(".")


def format_p_value(value: float) -> str:
    """Format a p-value with two significant digits."""
    return "< 0.0001" if value < 1e-4 else f"{value:.2g}" if value < 0.1 else f"{value:.2f}"


def shorten(text: str, most: int) -> str:
    """Shorten text to at most `most` columns, ending with '…'; East Asian wide letters take two columns."""
    text = " ".join(text.split())
    ends = list(accumulate(2 if east_asian_width(letter) in "FW" else 1 for letter in text))
    if not ends or ends[-1] <= most:
        return text
    return f"{text[: bisect_right(ends, most - 1)].rstrip()}…"


def format_table(rows: Sequence[tuple[str, ...]], begin: str = "") -> list[str]:
    """Format rows as lines with aligned columns."""
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        (begin + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]


_ADDRESS = re.compile(r"(?<!\w)0[xX][0-9a-fA-F]+")
"""An address in memory, such as that of an invalid pointer."""
_PATH = re.compile(r"(?<![\w.])(?<!:(?=//))(?<!:/)(?:/[^\s;:,|'\")/]+)*/([^\s;:,|'\")/]*)")
"""An absolute path outside of URLs; its last part is a group."""
_NUMBERED = re.compile(r"\d[a-zA-Z0-9]*")
"""In a file name: a digit and the following characters, which names of temporary files have."""
_NUMBER = re.compile(r"(?<!status )(?<!exit code )(?<!signal )(?<!HTTP )(?<!\d)\d+(\.\d+)?([eE][+-]?\d+)?")
"""A number, except for statuses, signals and exit codes, which are reasons."""


def kind_of(message: str) -> str:
    """Return the text that messages of one kind share.

    Numbers and memory addresses are replaced, except for statuses, exit codes and signals. Absolute paths are
    reduced to their last part, which distinguishes files of an experiment.
    """
    named = _PATH.sub(lambda path: f"/{_NUMBERED.sub('0', path[1])}", _ADDRESS.sub("0", message))
    return _NUMBER.sub("0", named)
