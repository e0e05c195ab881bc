"""Output of commands that compare runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from swarmwright.cli import _options as options
from swarmwright.cli._output import Output, complain
from swarmwright.cli._runs import reading_progress

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Comparison, Order
    from swarmwright.analysis.episodes import LeftOut
    from swarmwright.analysis.indicators import By
    from swarmwright.runs.run import Run


_ORDERS = ("rank", "name", "given")
INCOMPLETE = 1
"""Exit status if runs were excluded."""


def folders_of(paths: Sequence[Path]) -> list[Path]:
    """Return the folders among the paths; a pattern such as `runs/sweep/*` includes comparison.png.

    Files are ignored, with a message unless a sweep wrote them. Raises UsageError if there is no folder.
    """
    from swarmwright.analysis.sweep_folders import is_of_sweep

    folders = [path for path in paths if path.is_dir()]
    files = [str(path) for path in paths if not path.is_dir() and not is_of_sweep(path)]
    if not folders:
        files = [str(path) for path in paths]
        reason = "is not a run folder" if len(files) == 1 else "are not run folders"
        raise click.UsageError(f"{', '.join(files)} {reason}; name folders such as runs/minisim-1.")
    if files:
        reason = "is a file, not a run folder" if len(files) == 1 else "are files, not run folders"
        complain(f"left out: {', '.join(files)} {reason}")
    return folders


def run_folders(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return the run folders among the paths, and the missing ones of sweeps.

    The folder of a sweep stands for those of its runs. Raises the errors of `folders_of`, and InputError if
    the record of a sweep cannot be read or all of its runs are missing.
    """
    from swarmwright import InputError
    from swarmwright.analysis.sweep_folders import expand_folders, missing_words

    runs, missing = expand_folders(folders_of(paths))
    if not runs:
        raise InputError(missing_words(missing))
    if missing:
        complain(f"left out: {missing_words(missing)}")
    return runs, missing


def single_run(paths: Sequence[Path]) -> Path | None:
    """Return the folder of the only run among the paths and sweeps; None for several runs.

    Raises the errors of `run_folders`.
    """
    from swarmwright.analysis.sweep_folders import expand_folders

    runs, missing = expand_folders(path for path in paths if path.is_dir())
    if missing or len({run.resolve() for run in runs}) != 1:
        return None
    folders_of(paths)  # reports files
    return runs[0]


def readable_runs(folders: Sequence[Path]) -> "tuple[list[Run], list[LeftOut]]":
    """Return the readable runs and the others, which are reported on standard error.

    Raises InputError if no run is readable.
    """
    from swarmwright import InputError, Run
    from swarmwright.analysis.sweep_folders import exclude_unreadable

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
    return runs, [exclude_unreadable(folder, error) for folder, error in errors.items()]


@dataclass(frozen=True)
class ComparisonOptions:
    """Options of `runs compare` and `plot` for the comparison."""

    at: int | None = None
    held_out: bool = False
    criterion: "By" = "fitness"
    reference: tuple[tuple[str, float], ...] = ()
    offset: float | None = None
    at_episodes: int | None = None
    unfinished: bool = False
    order: "Order" = "rank"
    labels: tuple[tuple[str, str], ...] = ()

    @classmethod
    def from_options(cls, *, order: tuple[str, ...], **values: Any) -> Self:  # noqa: ANN401 - the fields
        """Create from the values of `compare_options`."""
        is_name = len(order) == 1 and order[0] in _ORDERS
        return cls(**values, order=order[0] if is_name else order or "rank")

    def check(self) -> None:
        """Raise UsageError for options that contradict each other."""
        options.exclude("--held-out", "--at", "--at-episodes")
        options.exclude("--at-episodes", "--at")
        if self.criterion != "fitness":
            options.exclude("--by", "--held-out", "--at-episodes")
        for option, value, criterion in (
            ("--reference", self.reference or None, "hypervolume"),
            ("--offset", self.offset, "qd_score"),
        ):
            if value is not None and self.criterion != criterion:
                raise click.UsageError(f"{option} needs --by {criterion}; add it, or leave out {option}.")
        names = [name for name, _ in self.reference]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise click.UsageError(f"--reference: {twice} is given twice; name each objective once.")


compare_options = options.gather(
    lambda **values: {"compared": ComparisonOptions.from_options(**values)},
    click.option(
        "--by",
        "criterion",
        type=click.Choice(["fitness", "hypervolume", "qd_score", "coverage"]),
        default="fitness",
        show_default=True,
        help="Value to compare: best fitness, hypervolume of nsga2 fronts, or QD score or coverage of "
        "map_elites and novelty archives.",
    ),
    click.option(
        "--reference",
        type=options.objective_value,
        multiple=True,
        metavar="NAME=VALUE",
        help="With --by hypervolume: reference point, a value for fitness and each objective. Default: "
        "objectives scaled to their range in the compared fronts, and a point 10 % beyond the worst.",
    ),
    click.option(
        "--offset",
        type=options.finite_number,
        metavar="FITNESS",
        help="With --by qd_score: worst possible fitness, subtracted from each elite's. Default: 0, or "
        "the lowest compared fitness if negative.",
    ),
    click.option(
        "--at",
        type=options.WholeNumber(min=1),
        metavar="EVALUATIONS",
        help="Compare the best of each run's first EVALUATIONS. Default: whole runs.",
    ),
    click.option(
        "--at-episodes",
        type=options.WholeNumber(min=1),
        metavar="EPISODES",
        help="Compare the best after at most EPISODES episodes, for runs that differ in ranking.episodes.",
    ),
    click.option(
        "--held-out", is_flag=True, help="Compare the best candidates by their validation on held-out seeds."
    ),
    click.option(
        "--unfinished",
        is_flag=True,
        help="Include runs that failed, were interrupted or are still running. Runs that reached --at or "
        "--at-episodes are always included.",
    ),
    click.option(
        "--order",
        multiple=True,
        metavar="ORDER",
        help="Order of the groups: rank (by median, best first), name, given (as listed), or group "
        "labels, each with its own --order. Default: rank.",
    ),
    click.option(
        "--label",
        "labels",
        type=options.parse_new_name,
        multiple=True,
        metavar="GROUP=NAME",
        help="Rename a group or task: --label nnga='genetic algorithm'. Repeatable.",
    ),
)
"""Options shared by commands that compare runs, which get `compared`, a `ComparisonOptions`."""


def show_comparison(
    output: Output, paths: Sequence[Path], compared: ComparisonOptions
) -> "tuple[Comparison, int]":
    """Compare runs and print a table or a JSON object; return the comparison and the exit status.

    The status is 1 if runs were excluded. Raises InputError, and UsageError for contradicting options.
    """
    from swarmwright.analysis.comparison import compare_opened
    from swarmwright.analysis.sweep_folders import exclude_missing

    compared.check()
    folders, missing = run_folders(paths)
    runs, unreadable = readable_runs(folders)
    comparison = compare_opened(
        runs,
        [*exclude_missing(missing), *unreadable],
        at=compared.at,
        at_episodes=compared.at_episodes,
        held_out=compared.held_out,
        by=compared.criterion,
        reference=dict(compared.reference) or None,
        offset=compared.offset,
        unfinished=compared.unfinished,
        order=compared.order,
        labels=dict(compared.labels),
    )
    output.block(str(comparison))
    output.json(comparison.to_mapping())
    return comparison, INCOMPLETE if comparison.left_out else 0
