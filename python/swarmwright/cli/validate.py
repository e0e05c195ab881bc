"""`swarmwright validate`: champions of a competition against opponents that evolution has not met."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._comparison import INCOMPLETE
from swarmwright.cli._evaluating import Evaluating, evaluation_options


@click.command(
    "validate",
    cls=Command,
    example="swarmwright validate runs/pursuit-1 runs/pursuit-2 runs/pursuit-3\n"
    "swarmwright validate runs/pursuit-1 their.bundle --champions 10 --episodes 30",
)
@click.argument("run", type=options.ExistingPath(folder=True), metavar="RUN")
@click.argument("against", nargs=-1, required=True, metavar="OPPONENT...")
@click.option(
    "--champions",
    type=options.WholeNumber(min=1, max=1000),
    metavar="N",
    default=1,
    show_default=True,
    help="Number of champions of RUN, of evenly spaced generations up to the last.",
)
@options.episodes_option("Number of episodes of each match.", default=30, most=1_000_000)
@options.seed_option(options.HELD_OUT_SEEDS)
@evaluation_options()
def command(
    run: Path,
    against: tuple[str, ...],
    champions: int,
    episodes: int,
    seed: int | None,
    evaluating: Evaluating,
) -> int:
    """Let champions of a competition play opponents that they have not met.

    RUN is a competition of two sides. OPPONENT is another run (its champions), RUN:GENERATION:CANDIDATE, a
    bundle, or a controller as JSON, or YAML of a machine; best are several runs of the same experiment with
    other seeds. The output has the mean fitness of each side, with a 95 % interval of a bootstrap over
    opponents and seeds, and the episodes that the side has won, drawn and lost.

    The exit status is 1 if opponents were left out.
    """
    from swarmwright import Run
    from swarmwright.analysis.competition_validation import validate_competition
    from swarmwright.runs.code import resolve_experiment

    opened = Run.open(run)
    experiment = evaluating.change(resolve_experiment(opened))
    with evaluating.episodes(experiment, episodes, seed) as where:
        validation = validate_competition(opened, experiment, against, where, champions=champions)
    evaluating.show(validation)
    return INCOMPLETE if validation.left_out else 0
