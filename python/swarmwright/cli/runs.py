"""`swarmwright runs`: list, filter, show, compare, export, verify and delete runs."""

import math
import operator
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Group
from swarmwright.cli._comparison import (
    INCOMPLETE,
    ComparisonOptions,
    compare_options,
    folders_of,
    readable_runs,
    run_folders,
    show_comparison,
)
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._output import Output, complain, print_note
from swarmwright.cli._runs import describe, facts_of, list_table, reading_progress
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_count
from swarmwright.common.suggestions import unknown_key

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swarmwright.cli._deletion import Deletion


COLUMNS = (
    *("run", "state", "simulation", "controller", "method", "seed", "generations", "evaluations", "failed"),
    *("best", "held_out", "seconds", "created"),
)
"""Keys for sorting and filtering runs, as in `runs list --json`."""
_CONDITION = re.compile(r"\s*([^\s<>=!]+)\s*(!=|<=|>=|=|<|>)(.*)", re.DOTALL)
_COMPARISONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True)
class Condition:
    """A condition on a column of the list or a key of the experiment: `method.population>=50`."""

    key: str
    operator: str
    value: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse KEY=VALUE, or another comparison."""
        match = _CONDITION.fullmatch(text)
        if match is None:
            raise click.BadParameter(
                f"'{text}' is not a condition: write KEY=VALUE, or !=, <, <=, > or >= instead of =, in "
                "quotes if it contains < or >."
            )
        return cls(match[1], match[2], match[3].strip())

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Return whether the condition holds for a run.

        A missing value, such as the best fitness of a run without a generation, satisfies only `!=`.
        Raises InputError if a number is compared with another type.
        """
        value, compare = values.get(self.key), _COMPARISONS[self.operator]
        if _is_missing(value):
            return self.operator == "!="
        is_equality = self.operator in {"=", "!="}
        if isinstance(value, int | float) and not isinstance(value, bool):
            try:
                return compare(value, float(self.value))
            except ValueError:
                if not is_equality:
                    raise InputError(
                        f"--filter {self.key}{self.operator}{self.value}: {self.value!r} is not a number"
                    ) from None
        text = str(value).lower() if isinstance(value, bool) else str(value)  # as in an experiment
        if is_equality:
            return fnmatchcase(text, self.value) == (self.operator == "=")
        return compare(text, self.value)


def filter_runs(
    runs: Sequence[Mapping[str, Any]],
    experiments: Sequence[Mapping[str, Any]],
    conditions: Sequence[Condition],
) -> list[Mapping[str, Any]]:
    """Return the runs for which all conditions hold.

    Args:
        runs: the columns of each run.
        experiments: the flat keys of each run's experiment.
        conditions: on columns, else on keys of experiments.

    Raises:
        InputError: no run has a key of a condition, or a number is compared with another type.
    """
    keys = {key for values in experiments for key in values}
    for condition in conditions:
        if runs and condition.key not in COLUMNS and condition.key not in keys:
            problem = unknown_key(condition.key, [*COLUMNS, *sorted(keys)])
            raise InputError(f"--filter {condition.key}: {problem}")
    return [
        run
        for run, experiment in zip(runs, experiments, strict=True)
        if all(filter_.holds({**experiment, **run}) for filter_ in conditions)
    ]


def sort_runs(runs: Sequence[Mapping[str, Any]], column: str, *, reverse: bool) -> list[Mapping[str, Any]]:
    """Return runs sorted by a column; those without a value come first, or last if reversed."""

    def key(run: Mapping[str, Any]) -> tuple[bool, Any, str]:
        value = run[column]
        missing = _is_missing(value)
        return (not missing, 0 if missing else value, run["created"])

    return sorted(runs, key=key, reverse=reverse)


def _is_missing(value: Any) -> bool:  # noqa: ANN401 - any value of an experiment
    return value is None or (isinstance(value, float) and math.isnan(value))


@click.group(
    "runs", cls=Group, modules={}, example="swarmwright runs list\nswarmwright runs show runs/minisim-1"
)
def command() -> None:
    """List, show, compare, export, verify and delete runs."""


@command.command(
    "list",
    example="swarmwright runs list\n"
    "swarmwright runs list --sort best --filter state=done\n"
    "swarmwright runs list --filter 'method.population>=50'\n"
    "swarmwright runs list results --json",
)
@click.argument(
    "folder", type=options.ExistingPath(folder=True), default=None, required=False, metavar="[DIR]"
)
@click.option(
    "--filter",
    "conditions",
    type=Condition.parse,
    multiple=True,
    metavar="CONDITION",
    help="Show only runs that match KEY=VALUE (or !=, <, <=, >, >=). KEY is a --sort column or an "
    "experiment key such as method.population; VALUE may have wildcards: method=*cma*. Repeatable.",
)
@click.option(
    "--sort",
    type=click.Choice(COLUMNS),
    default="created",
    show_default=True,
    help="Sort by this column, the largest value last.",
)
@click.option("--reverse", is_flag=True, help="Reverse the order.")
@options.json_option
def list_(
    folder: Path | None, conditions: tuple[Condition, ...], sort: str, reverse: bool, output: Output
) -> None:
    """List the runs in DIR (default: runs), the newest last.

    Damaged folders are listed with the reason. The table includes held-out fitness if runs were validated,
    and the number of failed evaluations if there are any.
    """
    from swarmwright import InputError, Run
    from swarmwright.common.values import flatten
    from swarmwright.runs.folders import RUNS
    from swarmwright.runs.store import FILE, StoreReader

    root = folder or RUNS
    runs, experiments, broken = [], [], []
    stores = sorted(root.glob(f"**/{FILE}"))
    with reading_progress(len(stores)) as begin:
        for number, store in enumerate(stores):
            begin(number)
            try:
                with StoreReader.open_snapshot(
                    store.parent
                ) as reader:  # one connection for all facts saves time
                    run = Run(store.parent, reader)
                    runs.append(facts_of(run))
                    experiments.append(flatten(run.experiment.to_mapping()) if conditions else {})
            except InputError as error:
                broken.append(str(error))
    shown = sort_runs(filter_runs(runs, experiments, conditions), sort, reverse=reverse)
    for facts in shown:
        output.json(facts)
    for reason in broken:
        output.json({"error": reason})
    if not runs and not broken:
        beside = folder is None and any(Path().glob(f"*/{FILE}"))  # created with `--out`
        cure = (
            "`swarmwright runs list .` lists those in" if beside else "`swarmwright optimize FILE` makes one"
        )
        output.text(f"No runs in {root}. {cure}{' the working folder' * beside}.")
    elif not output.as_json:
        if runs and not shown:
            output.text(f"None of the {format_count(len(runs), 'run')} in {root} matches.")
        else:
            list_table(output, shown)
        for reason in broken:
            output.item(reason)


@command.command("show", example="swarmwright runs show runs/minisim-1")
@click.argument("run", type=options.ExistingPath(folder=True))
@options.json_option
def show(run: Path, output: Output) -> None:
    """Show the experiment, results, servers and warnings of RUN."""
    from swarmwright import Run

    describe(output, Run.open(run))


@command.command(
    "elites",
    example="swarmwright runs elites runs/arena-1\n"
    "swarmwright runs elites runs/arena-1 --limit 0 --plot archive.png\n"
    "swarmwright runs elites runs/arena-1 --episodes 100\n"
    "swarmwright runs elites runs/arena-1 --json",
)
@click.argument("run", type=options.ExistingPath(folder=True))
@click.option(
    "--limit",
    type=click.IntRange(min=0),
    default=20,
    show_default=True,
    metavar="N",
    help="List the N candidates with the best fitness; 0 lists all. --json always has all.",
)
@options.figure_option("--plot", "Draw the archive as a heat map, or the front: .png, .svg or .pdf.")
@click.option(
    "--offset",
    type=options.finite_number,
    metavar="FITNESS",
    help="Worst possible fitness, subtracted from each elite's in the QD score. Default: 0.",
)
@options.episodes_option(
    "Evaluate each elite of an archive in N episodes on held-out seeds, and count those that are illusory: "
    "in another cell, or with less fitness than in the record.",
    most=100_000,
)
@options.seed_option("With --episodes: simulation seed of the first episode.")
@evaluation_options(settings=None, server_output=False)
def elites(
    run: Path,
    limit: int,
    file: Path | None,
    offset: float | None,
    episodes: int | None,
    seed: int | None,
    evaluating: Evaluating,
) -> None:
    """List the elites of RUN, an archive or a front.

    Archives come from map_elites and novelty (quality diversity), fronts from nsga2 (several objectives).
    `evaluate`, `replay`, `draw` and `export` take the listed generation and candidate. Of equal candidates on
    a front, the earliest is listed. The lines below the table count candidates without a value of a metric,
    or outside the range of a measure.
    """
    from swarmwright import Run, reproduce_elites
    from swarmwright.cli._runs import elites_facts, list_elites, list_reproduction
    from swarmwright.runs.code import resolve_experiment

    for option in ("--seed", "--broker", "--prefix", "--servers"):
        options.need(option, "--episodes")
    opened, output = Run.open(run), evaluating.output
    archive = opened.elites
    if offset is not None and archive.kind == "front":
        raise click.UsageError(
            "--offset is for the QD score of an archive, and this run has a front; leave it out."
        )
    offset = offset or 0.0
    if file is not None and archive.candidates:
        archive.plot(file)
    reproduction = None
    if episodes is not None:
        experiment = evaluating.change(resolve_experiment(opened))
        with evaluating.episodes(experiment, episodes, seed) as where:
            arguments = where._asdict() | {"experiment": experiment}
            del arguments["metrics"]
            reproduction = reproduce_elites(opened, **arguments)
    output.json(
        {
            "run": str(run),
            **elites_facts(archive, offset),
            "elites": [candidate._asdict() for candidate in archive.candidates],
            "held_out": None if reproduction is None else reproduction.to_mapping(offset),
            "picture": None if file is None or not archive.candidates else str(file),
        }
    )
    if not output.as_json:
        list_elites(output, archive, limit, offset)
        if reproduction is not None:
            list_reproduction(output, reproduction, offset)
        if file is not None and archive.candidates:
            output.text(f"The figure is in {file}")
    if file is not None and not archive.candidates:
        archive.plot(file)  # raises an error with the reason


@command.command(
    "diff",
    example="swarmwright runs diff runs/minisim-1 runs/minisim-1-2\nswarmwright runs diff results again",
)
@click.argument("first_path", type=options.ExistingPath(folder=True), metavar="RUN")
@click.argument("second_path", type=options.ExistingPath(folder=True), metavar="RUN")
@options.json_option
def diff(first_path: Path, second_path: Path, output: Output) -> int:
    """Compare the records of two runs, byte for byte.

    Print the first difference. The exit status is 0 if the records are identical, else 1. Both can be
    folders of sweeps: runs of the same name are compared and missing ones reported, with a line for each run
    in --json.
    """
    from swarmwright import Run
    from swarmwright.analysis.sweep_folders import runs_of
    from swarmwright.runs.differences import find_first_difference

    sweeps = runs_of(first_path), runs_of(second_path)
    if sweeps[0] is not None and sweeps[1] is not None:
        return show_differences(output, sweeps[0], sweeps[1])
    first, second = Run.open(first_path), Run.open(second_path)
    difference = find_first_difference(first, second)
    output.json({"same": difference is None, "difference": difference})
    if difference is None:
        output.text(f"The records are the same, byte for byte: {first.evaluations} evaluations.")
        output.text(f"SHA-256 {first.digest}")
        return 0
    output.text(f"The records differ: {difference}")
    return 1


@command.command(
    "compare",
    example="swarmwright runs compare runs/nnga-* runs/random-*\n"
    "swarmwright runs compare results/sizes --held-out\n"
    "swarmwright runs compare runs/* --at 1000 --json\n"
    "swarmwright runs compare runs/* --held-out --csv table.csv --latex table.tex\n"
    "swarmwright runs compare fronts/* --by hypervolume --reference fitness=0 --reference speed=0.12",
)
@click.argument("runs", type=options.ExistingPath(folder=None), nargs=-1, required=True, metavar="RUN...")
@compare_options
@click.option(
    "--csv",
    "csv_file",
    type=options.OutputFile(),
    help="Write the compared value of each run as a table, .csv.",
)
@click.option(
    "--latex",
    "latex_file",
    type=options.OutputFile(),
    help="Write groups and tests as LaTeX tables, .tex, for the package booktabs.",
)
@options.json_option
def compare(
    runs: tuple[Path, ...],
    csv_file: Path | None,
    latex_file: Path | None,
    output: Output,
    compared: ComparisonOptions,
) -> int:
    """Compare the best fitness that runs reached, or their fronts or archives.

    Print statistical tests and effect sizes. Runs that differ only in the seed form a group; groups are
    compared separately for each task, that is each simulation with its parameters and fitness. Fronts with
    the same objectives can be compared by hypervolume, archives with the same measures, ranges and bins by
    QD score or coverage.

    RUN can be the folder of a sweep. Files are ignored, so patterns such as results/* work. Runs that are
    unfinished, empty, damaged or missing are reported and excluded, and the exit status is 1.

    `swarmwright plot` draws the comparison; `swarmwright compare` compares two controllers.
    """
    from swarmwright.analysis import table

    targets = ((csv_file, table.CSV), (latex_file, table.LATEX))
    files = [(file, ending) for file, ending in targets if file is not None]
    for file, ending in files:
        table.check(file, ending)
    comparison, status = show_comparison(output, runs, compared)
    for file, _ in files:
        output.text(f"The table is in {comparison.export(file)}")
    return status


@command.command(
    "export",
    example="swarmwright runs export runs/minisim-1 evaluations.csv\n"
    "swarmwright runs export runs/minisim-1 evaluations.parquet\n"
    "swarmwright runs export runs/minisim-1 held-out.csv --validation\n"
    "swarmwright runs export results/sizes evaluations.parquet",
)
@click.argument("run", type=options.ExistingPath(folder=True))
@click.argument("file", type=options.OutputFile())
@click.option(
    "--validation",
    is_flag=True,
    help="Write the validation instead (.csv): generation, candidate, recorded fitness, seed, fitness and "
    "metrics of each episode.",
)
@options.json_option
def export(run: Path, file: Path, validation: bool, output: Output) -> int:
    """Write the record of RUN as a table.

    FILE is .csv or .parquet, with a row per evaluation, sorted by generation and candidate. The columns are
    generation, candidate, fitness, the fitness of each episode, metrics and genome. In .csv, each episode
    (episode_0, ..), each metric of an episode (NAME_0, ..) and each gene (g0, ..) has a column; in .parquet,
    the columns episodes, NAME and genome hold lists. A metric named like another column, such as episode,
    becomes metric_episode.

    RUN can be the folder of a sweep: the table then begins with the columns run, seed and the settings that
    differ. Missing, damaged and empty runs are reported and excluded, and the exit status is 1.
    """
    from swarmwright import InputError, Run
    from swarmwright.analysis.sweep_folders import runs_of

    if not validation and runs_of(run) is not None:
        return export_records(output, run, file)
    open_snapshot = Run.open(run)
    if validation:
        from swarmwright.runs.validation import format_validation_command

        recorded = open_snapshot.validation
        if recorded is None:
            raise InputError(
                f"{run}: has no validation; `{format_validation_command(open_snapshot)}` makes one"
            )
        recorded.export(file)
    else:
        open_snapshot.export(file)
    output.text(f"The {'validation' if validation else 'record'} is in {file}")
    output.json({"run": str(run), "file": str(file)})
    return 0


@command.command(
    "verify",
    example="swarmwright runs verify runs/minisim-1\n"
    "swarmwright runs verify results/sizes\n"
    "swarmwright runs verify runs/* --json",
)
@click.argument("runs", type=options.ExistingPath(folder=None), nargs=-1, required=True, metavar="RUN...")
@options.json_option
def verify(runs: tuple[Path, ...], output: Output) -> int:
    """Check the content of each RUN against its checksums.

    The record must match its SHA-256, and best.json the record. Damage is reported with its generation and
    table, and the exit status is 1. It is 2 if a folder is not a run or cannot be read, for example because
    another version of Swarmwright wrote it; --json has no line for it. Files are ignored, so patterns such
    as results/* work.

    RUN can be the folder of a sweep: all its runs are verified, and the exit status is 1 if some are
    missing.
    """
    from swarmwright import InputError
    from swarmwright.cli._runs import print_verification
    from swarmwright.runs.store import FILE
    from swarmwright.runs.verification import verify as verify_run

    status = 0
    for run, of_sweep in expand_sweeps(folders_of(runs)):
        if of_sweep and not (run / FILE).exists():
            output.json({"run": str(run), "ok": False, "missing": True})
            output.text(f"{run}: missing; the same sweep runs it")
            status = status or 1
            continue
        try:
            verification = verify_run(run)
        except InputError as error:  # continue with the others
            complain(str(error))
            status = error.exit_status
            continue
        status = status or (1 if verification.problems else 0)
        print_verification(output, run, verification)
    return status


@command.command(
    "delete",
    example="swarmwright runs delete runs/minisim-1 --yes\nswarmwright runs delete results/sizes",
)
@click.argument("runs", type=options.ExistingPath(folder=True), nargs=-1, required=True, metavar="RUN...")
@click.option("--yes", is_flag=True, help="Do not ask for confirmation.")
@options.json_option
def delete(runs: tuple[Path, ...], yes: bool, output: Output) -> int:
    """Delete runs, or sweeps with all of their runs.

    RUN can be the folder of a sweep: its runs, even damaged ones, and its own files are deleted. Files that
    Swarmwright did not write stay, with their folder. The exit status is 1 if you answer no.
    """
    from swarmwright.cli._deletion import Deletion

    deletions = [Deletion.from_folder(folder) for folder in {run.resolve(): run for run in runs}.values()]
    if not yes and not _is_confirmed(deletions):
        return 1
    for deletion in deletions:
        for folder, left in deletion.delete():
            output.json({"deleted": str(folder), "left": left})
            remark = f"; other files stay there: {', '.join(left)}" if left else ""
            output.text(f"Deleted {folder}{remark}")
    return 0


def _is_confirmed(deletions: "Sequence[Deletion]") -> bool:
    """Ask the user to confirm the deletion."""
    for deletion in deletions:
        print_note(deletion.words)
    runs = sum(len(deletion.runs) for deletion in deletions)
    subject = "this run" if runs == len(deletions) == 1 else f"these {format_count(runs, 'run')}"
    try:
        confirmed = click.confirm(f"Delete {subject} permanently?", err=True)
    except click.Abort:
        if sys.stdin.isatty():  # Ctrl-C
            raise
        raise click.UsageError(
            "there is no terminal to confirm on; give --yes. Nothing was deleted."
        ) from None
    if not confirmed:
        print_note("Nothing was deleted.")
    return confirmed


def expand_sweeps(folders: list[Path]) -> list[tuple[Path, bool]]:
    """Replace folders of sweeps by those of their runs; True marks a run that a sweep requires.

    Raises InputError if the record of a sweep cannot be read.
    """
    from swarmwright.analysis.sweep_folders import runs_of
    from swarmwright.runs.store import FILE

    paths: dict[Path, bool] = {}
    for folder in folders:
        sweep_runs = runs_of(folder)
        paths |= dict.fromkeys([folder] if sweep_runs is None else sweep_runs, sweep_runs is not None)
        if sweep_runs is not None:  # add runs of other sweeps in this folder
            paths = dict.fromkeys((store.parent for store in sorted(folder.glob(f"*/{FILE}"))), False) | paths
    return list(paths.items())


def export_records(output: Output, folder: Path, file: Path) -> int:
    """Write the records of a sweep's runs as one table; return the exit status, 1 if some are missing.

    Unlike comparisons, the table includes unfinished runs.
    """
    from swarmwright import InputError
    from swarmwright.analysis.sweep_table import write_records

    folders, missing = run_folders([folder])
    open_snapshot, unreadable = readable_runs(folders)
    runs = [run for run in open_snapshot if run.history]
    empty = [run for run in open_snapshot if not run.history]
    for run in empty:
        complain(f"left out: {run.path}: holds no finished generation to write")
    if not runs:
        raise InputError(f"{folder}: none of its runs holds a finished generation to write")
    write_records(runs, file)
    output.text(f"The records of {format_count(len(runs), 'run')} are in {file}")
    output.json({"run": str(folder), "file": str(file), "runs": [str(run.path) for run in runs]})
    return INCOMPLETE if missing or unreadable or empty else 0


def show_differences(output: Output, first_sweep: Sequence[Path], second_sweep: Sequence[Path]) -> int:
    """Compare the records of runs with the same name; return the exit status, 1 unless all are the same.

    Args:
        output: gets a line for each run that differs or is missing, with --json for each.
        first_sweep: runs of a sweep.
        second_sweep: runs of the other sweep.
    """
    second_runs = {run.name: run for run in second_sweep}
    same = 0
    for path in first_sweep:
        difference = _difference(path, second_runs.pop(path.name, None))
        same += difference is None
        output.json({"run": path.name, "same": difference is None, "difference": difference})
        if difference is not None:
            output.item(f"{path.name}: {difference}")
    for name in second_runs:
        output.json({"run": name, "same": False, "difference": "only the second sweep has it"})
        output.item(f"{name}: only the second sweep has it")
    whole = len(first_sweep) + len(second_runs)
    output.text(f"The records of {same} of {format_count(whole, 'run')} are the same, byte for byte.")
    return 0 if same == whole else 1


def _difference(first: Path, second: Path | None) -> str | None:
    """Describe the difference of two runs; None if their records are the same."""
    from swarmwright import Run
    from swarmwright.runs.differences import find_first_difference

    if second is None:
        return "only the first sweep has it"
    missing = [str(run) for run in (first, second) if not run.exists()]
    if missing:
        return f"{' and '.join(missing)}: missing"
    return find_first_difference(Run.open(first), Run.open(second))
