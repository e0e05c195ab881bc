"""What is made of a column of a log: last, mean, ..; exact sums, the same on every machine."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from swarmwright.common.suggestions import did_you_mean
from swarmwright.simulations.ros.reductions import FUNCTIONS

_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\(\s*(.+?)\s*\))?\s*")


@dataclass(frozen=True)
class Reduction:
    """A function of a column."""

    function: str
    column: str

    @classmethod
    def parse(cls, metric: str, text: str) -> Self:
        """Read `mean` or `mean(column)`. Raises ValueError."""
        match = _FORM.fullmatch(text)
        if match is None or match[1] not in FUNCTIONS:
            hint = did_you_mean(match[1], FUNCTIONS) if match else ""
            names = ", ".join(FUNCTIONS)
            raise ValueError(
                f"{metric}: {text!r} found, expected one of {names}, or such as mean(column){hint}"
            )
        return cls(match[1], match[2] or metric)

    def __str__(self) -> str:
        return f"{self.function}({self.column})"

    def of(self, column: Sequence[float]) -> float:
        """Return its value for a column, not empty; NaN where numbers in it have none."""
        if self.function not in {"first", "last", "count"} and any(map(math.isnan, column)):
            return math.nan  # the smallest of numbers and NaN would depend on their order
        try:
            return float(FUNCTIONS[self.function](column))
        except (OverflowError, ValueError):  # of numbers that are infinite, or together too large
            return math.nan
