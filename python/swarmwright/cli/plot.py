"""`swarmwright plot`: runs as figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import at_episodes_option, at_option, by_options, held_out_option, json_option
from swarmwright.cli._output import Output
from swarmwright.cli._parameter_types import ExistingPath, OutputFile, SaveOption

if TYPE_CHECKING:
    from swarmwright.analysis.indicators import By
    from swarmwright.cli._comparison import Compared


@click.command(
    "plot",
    cls=Command,
    example="swarmwright plot runs/minisim-1\n"
    "swarmwright plot results/sizes --out comparison.pdf\n"
    "swarmwright plot runs/nnga-* runs/random-* --out comparison.svg",
)
@click.argument("runs", type=ExistingPath(folder=None), metavar="RUN...", nargs=-1, required=True)
@click.option(
    "--out",
    "file",
    cls=SaveOption,
    type=OutputFile(),
    metavar="FILE",
    help="Where to draw: .png, .svg or .pdf. Default: plot.png in the folder of one run, comparison.png here "
    "for several.",
)
@click.option(
    "--x",
    type=click.Choice(["evaluations", "generations"]),
    default="evaluations",
    show_default=True,
    help="What the runs are drawn over.",
)
@by_options
@at_option
@at_episodes_option
@held_out_option
@json_option
def command(
    runs: tuple[Path, ...],
    file: Path | None,
    x: str,
    by: "By",
    reference: tuple[tuple[str, float], ...],
    offset: float | None,
    at: int | None,
    at_episodes: int | None,
    held_out: bool,
    as_json: bool,
) -> int:
    """Plot a run, or compare several.

    One run: fitness and diversity over its evaluations. Several runs: those that differ only in the seed
    form a group. The groups are drawn on one axis, and their final fitness, or what --by names, is tested
    (Mann-Whitney, Kruskal-Wallis, with effect sizes). RUN can be the folder of a sweep, which stands for its
    runs. Runs that are missing, damaged or without a generation are left out and named; the exit status is
    then 1.
    """
    from swarmwright.cli._comparison import INCOMPLETE, Compared, run_folders

    what = Compared(at, held_out, by, reference, offset, at_episodes)
    output = Output(as_json=as_json)
    folders, missing = run_folders(runs)
    if len({run.resolve() for run in folders}) == 1 and not missing and what == Compared():
        _draw_one(output, folders[0], file or folders[0] / "plot.png", x)
        return 0
    status = _draw_several(output, folders, file or Path("comparison.png"), x, what)
    return INCOMPLETE if missing else status


def _draw_one(output: Output, folder: Path, file: Path, x: str) -> None:
    from swarmwright import InputError, Run
    from swarmwright.core.formatting import counted
    from swarmwright.figures import style
    from swarmwright.figures.run import draw
    from swarmwright.runs.diversity import diversity

    style.check(file)
    run = Run.open(folder)
    if not run.history:
        raise InputError(f"{folder}: holds no finished generation to draw")
    values = diversity(run)
    style.save(draw(run, values, x=x), file)
    spread = [float(value) for value in values]
    last = run.history[-1]
    output.text(
        f"{counted(run.evaluations, 'evaluation')} in {counted(run.generations, 'generation')}: best fitness "
        f"{last.best_so_far + 0.0:.6g}, diversity {spread[-1]:.3g} at the end. The figure is in {file}"
    )
    output.json(
        {
            "run": str(folder), "picture": str(file), "evaluations": run.evaluations,
            "generations": run.generations, "best": last.best_so_far, "diversity": spread,
        }
    )  # fmt: skip


def _draw_several(output: Output, runs: Sequence[Path], file: Path, x: str, what: "Compared") -> int:
    from swarmwright.cli._comparison import show_comparison
    from swarmwright.figures import style

    style.check(file)
    comparison, status = show_comparison(output, runs, what)
    comparison.plot(file, x=x)
    output.text(f"The figure is in {file}")
    return status
