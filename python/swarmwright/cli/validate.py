"""`swarmwright validate`: champions of a competition against opponents that evolution has not met."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._comparison import INCOMPLETE
from swarmwright.cli._output import Output, show_warnings


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
    help="Number of champions of RUN, of evenly spaced generations. Default: the last.",
)
@click.option(
    "--episodes",
    type=options.WholeNumber(min=1, max=1_000_000),
    default=30,
    show_default=True,
    help="Number of episodes of each match.",
)
@click.option(
    "--seed",
    type=options.WholeNumber(min=0, max=2**62),
    metavar="S",
    help="Simulation seed of the first episode; the others count up. Default: held-out seeds that no run "
    "used.",
)
@options.set_option("Override a value of the experiment: parameters.maxSteps=40.")
@options.experiment_broker_options()
@options.servers_option
@options.server_output_option
@options.trust_option
@options.json_option
def command(
    run: Path,
    against: tuple[str, ...],
    champions: int,
    episodes: int,
    seed: int | None,
    settings: tuple[str, ...],
    broker: str | None,
    prefix: str | None,
    servers: options.Servers | None,
    output: Output,
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
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.cli.evaluate import NOT_EVALUATED, settable
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.code import resolve_experiment
    from swarmwright.runs.post_evaluation import EvaluationOptions

    show_warnings()
    refuse_seed(settings)
    opened = Run.open(run)
    changed = (*settings, *options.prefix_settings(prefix))
    experiment = resolve_experiment(opened).with_settings(changed, only=settable(), reason=NOT_EVALUATED)
    broker = options.experiment_broker(experiment, broker, servers)
    with shown_episodes(output) as on_progress:
        where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress)
        validation = validate_competition(opened, experiment, against, where, champions=champions)
    if settings:
        output.text(f"Settings: {', '.join(settings)}")
    output.block(str(validation))
    output.json({"settings": list(settings), **validation.to_mapping()})
    return INCOMPLETE if validation.left_out else 0
