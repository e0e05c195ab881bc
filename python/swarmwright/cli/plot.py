"""`swarmwright plot`: runs as figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._comparison import ComparisonOptions, compare_options, show_comparison, single_run
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright.display.figures.style import Page
    from swarmwright.runs.metric_curves import Names


@click.command(
    "plot",
    cls=Command,
    example="swarmwright plot runs/minisim-1\n"
    "swarmwright plot results/sizes --out comparison.pdf\n"
    "swarmwright plot runs/nnga-* runs/random-* --out comparison.svg",
)
@click.argument("runs", type=options.ExistingPath(folder=None), metavar="RUN...", nargs=-1, required=True)
@options.figure_option(
    "--out",
    "File to write: .png, .svg or .pdf. Default: plot.png in the run's folder, or comparison.png for "
    "several runs.",
)
@click.option(
    "--x",
    type=click.Choice(["evaluations", "generations"]),
    default="evaluations",
    show_default=True,
    help="Horizontal axis.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="Draw fitness and this metric, or all recorded ones with 'all'. One run shows the best "
    "candidate, the best quarter, the middle half and the worst quarter by fitness; several runs "
    "show the best quarter. Repeatable.",
)
@click.option(
    "--style",
    type=click.Choice(["screen", "ieee", "nature", "science", "acm", "elsevier", "springer"]),
    default="screen",
    show_default=True,
    help="Width, fonts and sizes of a publisher, without a title; screen: as wide as the figure needs.",
)
@click.option(
    "--width",
    metavar="WIDTH",
    help="Width of the figure: column or page of the style, inches, or a length such as 89mm. Default: "
    "one column.",
)
@click.option("--title", metavar="TEXT", help="Title of the figure; '' for none.")
@compare_options
@options.json_option
def command(
    runs: tuple[Path, ...],
    file: Path | None,
    x: str,
    metrics: tuple[str, ...],
    style: str,
    width: str | None,
    title: str | None,
    output: Output,
    compared: ComparisonOptions,
) -> int:
    """Plot a run, or compare several.

    For one run, draw fitness and diversity over its evaluations. For several, draw the groups of runs that
    differ only in the seed, and test their final fitness or the value of --by (Mann-Whitney, Kruskal-Wallis,
    effect sizes). RUN can be the folder of a sweep. Runs that are unfinished, empty, damaged or missing are
    reported and excluded, and the exit status is 1.
    """
    from swarmwright.display.figures.style import Page, use_page

    page = Page.from_options(style, width, title)
    run = single_run(runs) if compared == ComparisonOptions() else None
    if run is not None:
        with use_page(page):
            _draw_single(output, run, file or run / "plot.png", x, _parse_metrics(metrics))
        return 0
    return _draw_several(
        output, runs, file or Path("comparison.png"), x, compared, page, _parse_metrics(metrics)
    )


def _parse_metrics(metrics: tuple[str, ...]) -> "Names | None":
    return "all" if metrics == ("all",) else metrics or None


def _draw_single(output: Output, folder: Path, file: Path, x: str, metrics: "Names | None") -> None:
    from swarmwright import InputError, Run
    from swarmwright.common.formatting import format_count
    from swarmwright.display.figures import style
    from swarmwright.display.figures.metrics import draw as of_metrics
    from swarmwright.display.figures.run import draw
    from swarmwright.runs.diversity import diversity
    from swarmwright.runs.metric_curves import MetricCurves, select_names

    style.check_figure_path(file)
    run = Run.open(folder)
    if not run.history:
        raise InputError(f"{folder}: holds no finished generation to draw")
    values = diversity(run)
    if metrics is None:
        style.save(draw(run, values, x=x), file)
    else:
        style.save(of_metrics(run, MetricCurves(run, select_names([run], metrics)), x=x), file)
    spread = [float(value) for value in values]
    last = run.history[-1]
    output.text(
        f"{format_count(run.evaluations, 'evaluation')} in {format_count(run.generations, 'generation')}: "
        "best fitness "
        f"{last.best_so_far + 0.0:.6g}, diversity {spread[-1]:.3g} at the end. The figure is in {file}"
    )
    output.json(
        {
            "run": str(folder), "picture": str(file), "evaluations": run.evaluations,
            "generations": run.generations, "best": last.best_so_far, "diversity": spread,
        }
    )  # fmt: skip


def _draw_several(
    output: Output,
    runs: Sequence[Path],
    file: Path,
    x: str,
    compared: ComparisonOptions,
    page: "Page",
    metrics: "Names | None",
) -> int:
    from swarmwright.display.figures import style
    from swarmwright.display.figures.style import use_page

    style.check_figure_path(file)
    comparison, status = show_comparison(output, runs, compared)
    with use_page(page):
        style.save(comparison._draw_figure(x, metrics), file)
    output.text(f"The figure is in {file}")
    return status
