"""Output of commands that compare runs."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from swarmwright.cli._output import Output, complain
from swarmwright.cli._runs import reading_progress

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Order
    from swarmwright.analysis.episodes import LeftOut
    from swarmwright.analysis.indicators import By
    from swarmwright.runs.run import Run


_ORDERS = ("rank", "name", "given")
INCOMPLETE = 1
"""Exit status where runs were left out."""


def folders_of(paths: Sequence[Path]) -> list[Path]:
    """Return the folders among what was named; `runs/sweep/*` names the sweep's comparison.png, too.

    Files are left out, others than a sweep's with a message on standard error. Raises UsageError when nothing
    is left.
    """
    from swarmwright.analysis.sweep_folders import is_of_sweep

    folders = [path for path in paths if path.is_dir()]
    files = [str(path) for path in paths if not path.is_dir() and not is_of_sweep(path)]
    if not folders:
        files = [str(path) for path in paths]
        which = "is not a run folder" if len(files) == 1 else "are not run folders"
        raise click.UsageError(f"{', '.join(files)} {which}; name folders such as runs/minisim-1.")
    if files:
        which = "is a file, not a run folder" if len(files) == 1 else "are files, not run folders"
        complain(f"left out: {', '.join(files)} {which}")
    return folders


def run_folders(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return the run folders among what was named, and those of sweeps that are missing.

    Of the folder of a sweep, the folders of its runs are meant. Raises as `folders_of`, and InputError where
    the record of a sweep cannot be read or none of its runs is there.
    """
    from swarmwright import InputError
    from swarmwright.analysis.sweep_folders import expanded, missing_words

    found, missing = expanded(folders_of(paths))
    if not found:
        raise InputError(missing_words(missing))
    if missing:
        complain(f"left out: {missing_words(missing)}")
    return found, missing


def single_run(paths: Sequence[Path]) -> Path | None:
    """Return the folder of the run that is named alone, or is the only one of a sweep; None for several.

    Raises as `run_folders`.
    """
    from swarmwright.analysis.sweep_folders import expanded

    found, missing = expanded(path for path in paths if path.is_dir())
    if missing or len({run.resolve() for run in found}) != 1:
        return None
    folders_of(paths)  # names files among them
    return found[0]


def readable_runs(folders: Sequence[Path]) -> "tuple[list[Run], list[LeftOut]]":
    """Return the runs that can be read, and the others, which are named on standard error.

    Raises InputError when there is nothing else.
    """
    from swarmwright import InputError, Run
    from swarmwright.analysis.sweep_folders import as_unreadable

    runs: list[Run] = []
    errors: dict[Path, InputError] = {}
    with reading_progress(len(folders)) as begin:
        for number, folder in enumerate(folders):
            begin(number)
            try:
                runs.append(Run.open(folder))
            except InputError as error:
                errors[folder] = error
    if errors and not runs:
        raise next(iter(errors.values()))
    for problem in errors.values():
        complain(f"left out: {problem}")
    return runs, [as_unreadable(folder, error) for folder, error in errors.items()]


@dataclass(frozen=True)
class Compared:
    """What of runs is compared: the options of `runs compare` and `plot`."""

    at: int | None = None
    held_out: bool = False
    by: "By" = "fitness"
    reference: tuple[tuple[str, float], ...] = ()
    offset: float | None = None
    at_episodes: int | None = None
    unfinished: bool = False
    order: "Order" = "rank"
    labels: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, options: dict[str, Any]) -> Self:
        """Take the options of `compare_options` out of those of a command."""
        given = {name: options.pop(name) for name in (field.name for field in fields(cls))}
        order = given["order"]
        if len(order) == 1 and order[0] in _ORDERS:
            order = order[0]
        return cls(**{**given, "order": order or "rank"})

    def check(self) -> None:
        """Raise UsageError for options that contradict each other."""
        if self.held_out and self.at is not None:
            raise click.UsageError("--held-out compares runs at their end; leave out --at.")
        if self.at_episodes is not None and (self.at is not None or self.held_out or self.by != "fitness"):
            raise click.UsageError(
                "--at-episodes compares the best recorded fitness after so many episodes; leave out --at, "
                "--held-out and --by, or leave out --at-episodes."
            )
        if self.held_out and self.by != "fitness":
            raise click.UsageError("--held-out compares fitness; leave out --held-out, or leave out --by.")
        if self.reference and self.by != "hypervolume":
            raise click.UsageError(
                "--reference is for --by hypervolume; leave it out, or give --by hypervolume."
            )
        names = [name for name, _ in self.reference]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise click.UsageError(f"--reference: {twice} is given twice; name each objective once.")
        if self.offset is not None and self.by != "qd_score":
            raise click.UsageError("--offset is for --by qd_score; leave it out, or give --by qd_score.")


def show_comparison(output: Output, paths: Sequence[Path], what: Compared) -> "tuple[Comparison, int]":
    """Compare runs and print it, as a table or as one JSON object; return it, and the exit status.

    That is 1 where runs were left out. Raises InputError, and UsageError for options that contradict each
    other.
    """
    from swarmwright.analysis.comparison import compare_opened
    from swarmwright.analysis.sweep_folders import as_missing

    what.check()
    folders, missing = run_folders(paths)
    runs, unreadable = readable_runs(folders)
    comparison = compare_opened(
        runs,
        [*as_missing(missing), *unreadable],
        at=what.at,
        at_episodes=what.at_episodes,
        held_out=what.held_out,
        by=what.by,
        reference=dict(what.reference) or None,
        offset=what.offset,
        unfinished=what.unfinished,
        order=what.order,
        labels=dict(what.labels),
    )
    output.block(str(comparison))
    output.json(comparison.to_mapping())
    return comparison, INCOMPLETE if comparison.left_out else 0
