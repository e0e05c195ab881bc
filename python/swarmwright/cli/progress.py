"""`swarmwright progress`: whether competing sides become better."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._evolving import program
from swarmwright.common.formatting import format_count
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright.analysis.competition import SideProgress


@click.command(
    "progress",
    cls=Command,
    example="swarmwright progress runs/pursuit-1\n"
    "swarmwright progress runs/pursuit-1 --episodes 30 --out progress.png",
)
@click.argument("run", type=options.ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--champions",
    type=options.WholeNumber(min=2, max=1000),
    metavar="N",
    default=30,
    show_default=True,
    help="Number of champions of each side, of evenly spaced generations.",
)
@options.episodes_option("Number of episodes of each match.", default=10, least=2, most=10_000)
@options.seed_option("First simulation seed; the others count up.", default=1_000_000_000)
@options.file_options(
    "Draw the outcomes of all matches, means and ratings: .png, .svg or .pdf.",
    "Write mean fitness and rating of each champion, with 95 % intervals, as a table, .csv.",
)
@evaluation_options()
def command(
    run: Path,
    champions: int,
    episodes: int,
    seed: int,
    picture: Path | None,
    table: Path | None,
    evaluating: Evaluating,
) -> None:
    """Show whether the sides of a competition become better, or go in circles.

    The champions of all generations of each side meet those of the other side, or of all other sides together
    (master tournament). The fitness of a competition does not show progress, since the opponents change with
    it.
    """
    from swarmwright import Run
    from swarmwright.analysis.competition import measure_progress
    from swarmwright.runs.code import resolve_experiment

    opened, output = Run.open(run), evaluating.output
    experiment = evaluating.change(resolve_experiment(opened))
    with evaluating.episodes(experiment, episodes, seed) as where:
        result = measure_progress(
            opened,
            experiment=experiment,
            champions=champions,
            episodes=episodes,
            seed=seed,
            broker=where.broker,
            servers=where.servers,
            on_progress=where.on_progress,
        )
    evaluating.show_settings()
    count = format_count(len(result.sides[0].generations), "champion")
    output.text(
        f"{count} of each side met those of all other sides, {format_count(episodes, 'episode')} each."
    )
    for side in result.sides:
        for line in _lines(side, run):
            output.text(line)
    options.write_files(output, result, picture, table)
    output.json({"settings": list(evaluating.settings), **result.to_mapping()})


def _lines(side: "SideProgress", run: Path) -> Iterator[str]:
    name, opponent = escape_line(side.side), escape_line(side.opponents)
    interval = f"95 % interval {side.gain_low:.3g} to {side.gain_high:.3g}"
    yield (
        f"{name}: {side.verdict}. From the first tenth to the last, mean fitness changed by {side.gain:.3g}, "
        f"{interval}."
    )
    low, high = side.null
    share = f"{side.cyclic_share:.1%} of the differences between champions depend on the opponent alone"
    expected = f"{low:.1%} to {high:.1%} are expected from noise"
    if side.cycles:
        yield f"  It goes in circles: {share} ({expected}), so who is better depends on the {opponent}."
    else:
        yield f"  No sign of circles: {share} ({expected})."
    yield (
        f"  Generation to take: {side.take}, the earliest that is not clearly worse than the best. Export it:"
    )
    folder, group = shlex.quote(str(run)), shlex.quote(name)
    yield f"  {program()} export {folder} --generation {side.take} --group {group} --to c"
