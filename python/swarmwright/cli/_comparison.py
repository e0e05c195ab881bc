"""What commands print of runs beside each other."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright._results.comparison import Comparison


def show_comparison(output: Output, runs: Sequence[Path], *, at: int | None = None) -> "Comparison":
    """Compare runs and print it, as a table or as one JSON object; return it.

    at: evaluations after which to compare; None: at each run's end. Raises InputError.
    """
    from swarmwright._results.comparison import compare

    comparison = compare(runs, at=at)
    output.text(str(comparison))
    output.json(comparison.to_mapping())
    return comparison
