"""`swarmwright score`: evaluate the candidates of a FREVO result."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, OutputFile, SaveOption, WholeNumber, json_option, need
from swarmwright.cli._output import Output, complain


@click.command(
    "score",
    cls=Command,
    example="swarmwright score emergency_exit_stadium.zre\n"
    "swarmwright score old/result.zre --field stadium.json --json\n"
    "swarmwright score old/result.zre --save best.json",
)
@click.argument("file", type=ExistingPath(), metavar="FILE.zre")
@click.option(
    "--field",
    type=ExistingPath(),
    metavar="FIELD",
    help="The field, as JSON or FREVO's .ser. Default: the one that FILE names, next to FILE.",
)
@click.option(
    "--save",
    "target",
    cls=SaveOption,
    type=OutputFile(),
    metavar="FILE.json",
    help="Write a candidate's controller there, which `simulate --controller`, `start_from` in an experiment "
    "and `draw` take.",
)
@click.option(
    "--candidate",
    type=WholeNumber(min=0),
    help="The candidate to save. Default: the one with the highest fitness here.",
)
@json_option
def command(
    file: Path, field: Path | None, target: Path | None, candidate: int | None, output: Output
) -> None:
    """Evaluate the candidates of a FREVO result.

    Both fitness values are shown. The candidates of FILE.zre are run in this process, on the problem that the
    file names. The method that evolved them, and the ranking, do not matter.
    """
    need("--candidate", "--save")
    from swarmwright import Controller
    from swarmwright.interop import frevo

    scores = frevo.score(file, field=field)
    if candidate is not None and candidate >= len(scores):
        raise click.UsageError(
            f"--candidate {candidate}: the file has the candidates 0 to {len(scores) - 1}."
        )
    for note in scores.notes:
        complain(f"not as in FREVO: {note}")
    output.text(f"{'candidate':>9} {'fitness':>22} {'FREVO':>22} {'difference':>10}")
    for score in scores:
        output.text(f"{score.index:9} {score.fitness!r:>22} {score.frevo!r:>22} {score.difference:10.3g}")
    largest = scores.max_difference
    output.text(f"{len(scores)} candidates, largest difference {largest:.3g}")
    candidates = [{"index": score.index, "fitness": score.fitness, "frevo": score.frevo} for score in scores]
    if target is not None:
        saved = scores.best if candidate is None else scores.candidates[candidate]
        Controller(saved.specification).save(target)
        output.text(f"{target}: the controller of candidate {saved.index}")
    output.json({"candidates": candidates, "max_difference": largest})
