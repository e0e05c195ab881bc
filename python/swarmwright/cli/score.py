"""`swarmwright score`: FREVO's networks, evaluated again."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output, complain
from swarmwright.cli.import_ import FIELD_HELP


@click.command(
    "score",
    cls=Command,
    example="swarmwright score emergency_exit_stadium.zre\n"
    "swarmwright score old/result.zre --field stadium.json --json",
)
@click.argument("file", type=ExistingPath(), metavar="FILE.zre")
@click.option("--field", type=ExistingPath(), metavar="FIELD", help=FIELD_HELP)
@json_option
def command(file: Path, field: Path | None, as_json: bool) -> None:
    """Evaluate every candidate of a FREVO result again, and show both fitness values.

    The candidates of FILE.zre are run in this process, on the problem that the file names. The method that
    evolved them, and the ranking, do not matter.
    """
    from swarmwright import frevo

    output = Output(as_json=as_json)
    scores = frevo.score(file, field=field)
    for note in scores.notes:
        complain(f"not as in FREVO: {note}")
    output.text(f"{'candidate':>9} {'fitness':>22} {'FREVO':>22} {'difference':>10}")
    for one in scores:
        output.text(f"{one.index:9} {one.fitness!r:>22} {one.frevo!r:>22} {one.difference:10.3g}")
    largest = scores.max_difference
    output.text(f"{len(scores)} candidates, largest difference {largest:.3g}")
    candidates = [{"index": one.index, "fitness": one.fitness, "frevo": one.frevo} for one in scores]
    output.json({"candidates": candidates, "max_difference": largest})
