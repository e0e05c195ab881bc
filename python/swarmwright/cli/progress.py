"""`swarmwright progress`: whether competing sides become better."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evolving import program
from swarmwright.cli._output import Output, show_warnings
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright.analysis.competition import CompetitionProgress, SideProgress


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
@click.option(
    "--episodes",
    type=options.WholeNumber(min=2, max=10_000),
    metavar="N",
    default=10,
    show_default=True,
    help="Episodes of each match.",
)
@click.option(
    "--seed",
    type=options.WholeNumber(min=0, max=2**62),
    metavar="S",
    default=1_000_000_000,
    show_default=True,
    help="First simulation seed; the others count up.",
)
@options.episodes_options(
    "Draw the outcomes of all matches, means and ratings: .png, .svg or .pdf.",
    "Write mean fitness and rating of each champion, with 95 % intervals, as a table, .csv.",
)
@options.experiment_broker_options("Use the servers on this broker. Default: the run's.")
@options.servers_option
@options.server_output_option
@options.trust_option
@options.json_option
def command(
    run: Path,
    champions: int,
    episodes: int,
    seed: int,
    picture: Path | None,
    table: Path | None,
    broker: str | None,
    prefix: str | None,
    servers: options.Servers | None,
    output: Output,
) -> None:
    """Show whether the sides of a competition become better, or go in circles.

    The champions of all generations of one side meet those of the other (master tournament). The fitness of a
    competition does not show progress, since the opponents change with it.
    """
    from swarmwright import Run
    from swarmwright.analysis.competition import color_sides, measure_progress
    from swarmwright.cli._progress import episodes as show_episodes
    from swarmwright.display.figures import style
    from swarmwright.display.figures.progress import Champions, draw_progress

    show_warnings()
    opened = Run.open(run)
    with show_episodes(output) as on_progress:
        result = measure_progress(
            opened,
            champions=champions,
            episodes=episodes,
            seed=seed,
            broker=broker,
            prefix=prefix,
            servers=servers,
            on_progress=on_progress,
        )
    for line in _lines(result, run):
        output.text(line)
    if table is not None:
        result.export(table)
        output.text(f"The table is in {table}")
    if picture is not None:
        sides = [Champions(*(getattr(side, name) for name in Champions._fields)) for side in result.sides]
        generations, heading = result.sides[0].generations, f"Progress of {opened.name}"
        style.save(draw_progress(sides, generations, heading, color_sides(opened.experiment)), picture)
        output.text(f"The figure is in {picture}")
    output.json(
        {
            "run": str(run),
            "sides": {side.side: side.summary() for side in result.sides},
            "cycles": any(side.cycles for side in result.sides),
            "champions": len(result.sides[0].generations),
            "episodes": result.episodes,
            "seed": result.seed,
        }
    )


def _lines(result: "CompetitionProgress", run: Path) -> Iterator[str]:
    count = len(result.sides[0].generations)
    yield f"{count} champions of each side met all of the other side, {result.episodes} episodes each."
    for side, other in zip(result.sides, reversed(result.sides), strict=True):
        yield from _side_lines(side, other, run)


def _side_lines(side: "SideProgress", other: "SideProgress", run: Path) -> Iterator[str]:
    name, opponent = escape_line(side.side), escape_line(other.side)
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
