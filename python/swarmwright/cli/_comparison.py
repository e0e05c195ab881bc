"""Output of commands that compare runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._output import Output, complain

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison


def run_folders(paths: Sequence[Path]) -> list[Path]:
    """Return the folders among what was named; `runs/sweep/*` names the sweep's comparison.png, too.

    Files are left out with a message on standard error. Raises UsageError when nothing is left.
    """
    folders = [path for path in paths if path.is_dir()]
    files = [str(path) for path in paths if not path.is_dir()]
    if not folders:
        which = "is not a run folder" if len(files) == 1 else "are not run folders"
        raise click.UsageError(f"{', '.join(files)} {which}; name folders such as runs/minisim-1.")
    if files:
        which = "is a file, not a run folder" if len(files) == 1 else "are files, not run folders"
        complain(f"left out: {', '.join(files)} {which}")
    return folders


def show_comparison(
    output: Output, runs: Sequence[Path], *, at: int | None = None, held_out: bool = False
) -> "Comparison":
    """Compare runs and print it, as a table or as one JSON object; return it.

    at: evaluations after which to compare; None: at each run's end. held_out: compare fitness on held-out
    seeds. Raises InputError.
    """
    from swarmwright.analysis.comparison import compare

    if held_out and at is not None:
        raise click.UsageError("--held-out compares runs at their end; leave --at.")
    comparison = compare(runs, at=at, held_out=held_out)
    output.block(str(comparison))
    output.json(comparison.to_mapping())
    return comparison
