"""`swarmwright sweep`: an experiment in many variants, and how they compare."""

import shlex
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import SETTINGS, Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._observing import ObserverOptions, observe_run, observe_sweep_options
from swarmwright.cli._output import Output, complain
from swarmwright.cli._signals import INTERRUPTED
from swarmwright.common.formatting import format_count

if TYPE_CHECKING:
    from swarmwright.analysis.sweep import Outcome

FAILED = 1


@click.command(
    "sweep",
    cls=Command,
    instead=SETTINGS,
    example="swarmwright sweep methods.yaml --servers 4\n"
    "swarmwright sweep methods.yaml --out results\n"
    "swarmwright sweep results/sweep.json --out again",
)
@click.argument("file", type=options.ExistingPath())
@options.folder_option(
    "Folder for the runs. Default: FILE's, else runs/ and FILE's name; for a sweep.json, its own folder."
)
@click.option(
    "--jobs",
    type=options.WholeNumber(min=1, max=1024),
    help="Number of simultaneous runs. Default: one per started server, one per processor with --servers "
    "local, or as many as the servers on the broker can serve.",
)
@observe_sweep_options
@evaluation_options(settings="Override a value in all variants: method.generations=50.", server_output=False)
def command(
    file: Path, out: Path | None, jobs: int | None, observing: ObserverOptions, evaluating: Evaluating
) -> int:
    """Run an experiment with several settings and seeds, and compare.

    Every variant in FILE is run with every seed, several runs at a time where they do not compete for
    servers. Repeat the command to continue after Ctrl-C, or after adding seeds or values or raising limits
    in FILE or with --set: finished runs are kept or extended, interrupted runs continue. A failed run does
    not stop the others; it is reported and excluded from comparisons, and the exit status is 1. Several
    processes, also on several machines, can work on one sweep. `runs delete` deletes the folder of a sweep.

    At the end, the variants are compared by recorded fitness, and by fitness on held-out seeds if all runs
    were validated and fitness depends on the seed. Variants of nsga2 with the same objectives (up to 3
    besides fitness) are also compared by hypervolume, those of map_elites and novelty with the same measures
    by QD score and coverage. The folder gets comparison.png, comparison.csv, comparison.tex and sweep.json
    (variants, seeds and --set).

    FILE can be a sweep.json. With --out, the sweep is repeated in that folder with the recorded experiments
    and code, and `runs diff` compares both; without --out, missing runs are run.
    """
    from swarmwright.analysis.sweep import Sweep, conduct, list_tasks
    from swarmwright.analysis.sweep.run import UnreadableRunError
    from swarmwright.cli._sweep_report import Report

    output = evaluating.output
    sweep = Sweep.load(file, out=out, settings=evaluating.changes)
    broker = evaluating.broker_of(sweep.variants[0].experiment)
    todo = list_tasks(sweep)
    longer = 0
    for task in todo:
        with suppress(UnreadableRunError):  # reported among the runs
            existing = task.open_run()  # report errors before anything is printed
            longer += existing is not None and bool(task.budget_settings(existing))
    if observing.tensorboard is not None:
        from swarmwright.runs.callbacks._tensorboard import require_writer

        require_writer()
    output.text(
        f"{format_count(len(sweep.variants), 'variant')} with {format_count(len(sweep.seeds), 'seed')} each: "
        f"{format_count(len(todo), 'run')} in {sweep.out}"
    )
    if longer:
        output.text(f"{format_count(longer, 'run')} had a smaller budget and will continue.")
    try:
        with observe_run(output, observing) as observer:
            report = Report(output, observer, todo, observing.tensorboard)
            with report.show():
                outcome = conduct(sweep, todo, report, jobs=jobs, broker=broker, servers=evaluating.servers)
            report.conclude()
        _conclude(output, outcome, sweep.out)
        if outcome.interrupted:
            done, whole = len(outcome.runs), len(todo)
            output.text(f"Interrupted after {done} of {whole} runs; run the same command to continue.")
            return INTERRUPTED
    except KeyboardInterrupt:
        complain("interrupted; finished runs are kept. Run the same command to continue")
        return INTERRUPTED
    return FAILED if outcome.failures else 0


def _conclude(output: Output, outcome: "Outcome", folder: Path) -> None:
    """Print the comparison and the missing runs, then write its files, which may fail on a full disk."""
    from swarmwright.analysis.comparison import compare_all
    from swarmwright.analysis.indicators import find_quick_indicators, find_shared_indicators

    runs = outcome.finished
    comparisons = compare_all(*outcome.open_runs())
    for comparison in comparisons:
        output.text()
        output.block(str(comparison))
    if find_quick_indicators(runs) != find_shared_indicators(runs):
        output.text()
        output.text(
            "Hypervolume is omitted because it is slow for fronts of this size or so many objectives; "
            f"`swarmwright runs compare {shlex.quote(str(folder))} --by hypervolume` computes it"
        )
    for task, message in outcome.failures.items():
        output.item(f"Failed: {task.variant.label}, seed {task.seed}: {message}")
    for task in outcome.busy:
        output.text(
            f"Left to another process: {task.variant.label}, seed {task.seed}; repeat the command when it "
            "has ended to include it"
        )
    if not comparisons:
        return
    picture = _write_file(comparisons[0].plot, folder / "comparison.png")
    tables = [
        _write_file(comparisons[0].export, folder / f"comparison{ending}") for ending in (".csv", ".tex")
    ]
    written = [str(table) for table in tables if table is not None]
    if written:
        output.text(f"Tables are in {' and '.join(written)}")
    if picture is not None:
        output.text(f"The figure is in {picture}")
    validated = comparisons[0].held_out
    recorded, *indicators = comparisons[validated:]
    output.json(
        {
            "held_out": comparisons[0].to_mapping() if validated else None,
            "comparison": recorded.to_mapping(),
            "indicators": [indicator.to_mapping() for indicator in indicators],
            "picture": None if picture is None else str(picture),
            "tables": written,
        }
    )


def _write_file(write: Callable[[Path], Path], path: Path) -> Path | None:
    """Write a file of the comparison; return its path, or None with a message if that fails."""
    from swarmwright import InputError

    try:
        return write(path)
    except InputError as error:
        complain(f"the runs are complete, but a comparison file could not be written: {error}")
        return None
