"""`swarmwright league`: a league table of controllers in a folder."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._comparison import INCOMPLETE
from swarmwright.cli._output import Output, show_warnings

if TYPE_CHECKING:
    from swarmwright import Experiment


@click.command(
    "league",
    cls=Command,
    example="swarmwright league bundles --experiment soccer.yaml --episodes 30\n"
    "swarmwright league runs --output table.md\n"
    "swarmwright league bundles --seed 1000 --json",
)
@click.argument("folder", type=options.ExistingPath(folder=True), metavar="FOLDER")
@click.option(
    "--experiment",
    "experiment_file",
    type=options.ExistingPath(folder=False),
    help="Experiment with matches of two sides. Default: FOLDER/league.yaml, or that of the first run or "
    "bundle.",
)
@click.option(
    "--episodes",
    type=options.WholeNumber(min=1, max=1_000_000),
    default=10,
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
@click.option(
    "--output",
    "target",
    cls=options.OutputOption,
    type=options.OutputFile(),
    metavar="FILE.md",
    help="Write the table as Markdown, too.",
)
@options.experiment_broker_options()
@options.servers_option
@options.server_output_option
@options.trust_option
@options.json_option
def command(
    folder: Path,
    experiment_file: Path | None,
    episodes: int,
    seed: int | None,
    settings: tuple[str, ...],
    target: Path | None,
    broker: str | None,
    prefix: str | None,
    servers: options.Servers | None,
    output: Output,
) -> int:
    """Rank controllers by matches of each against all others.

    FOLDER has run folders (their best candidates), bundles, and controllers as JSON, or YAML of a machine.
    Each plays each other on both sides, if its controllers fit both, in the same episodes. The table has
    points, and Bradley-Terry ratings in the units of Elo's, with 95 % intervals of a bootstrap over seeds. It
    states seeds and SHA-256 digests, with which anybody can repeat it.

    If the experiment has populations, whose sides have different tasks, there is a table for each side: a
    game compares the fitness of two controllers against the same opponent and seed.

    The exit status is 1 if files or folders were left out.
    """
    from swarmwright.analysis.league import EXPERIMENT, find_entries, find_experiment, play_league
    from swarmwright.analysis.table import check
    from swarmwright.cli._experiments import experiment_of
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.cli.evaluate import NOT_EVALUATED, settable
    from swarmwright.common.files import write_text
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.post_evaluation import EvaluationOptions

    show_warnings()
    refuse_seed(settings)
    if target is not None:
        check(target, ".md")
    changed = (*settings, *options.prefix_settings(prefix))
    names = find_entries(folder)
    if experiment_file is None and (folder / EXPERIMENT).is_file():
        experiment_file = folder / EXPERIMENT
    if experiment_file is not None:
        experiment: Experiment | None = experiment_of(experiment_file, changed)
    else:
        experiment = find_experiment(folder, names)
        if experiment is not None:
            experiment = experiment.with_settings(changed, only=settable(), reason=NOT_EVALUATED)
    if experiment is not None:
        broker = options.experiment_broker(experiment, broker, servers)
    with shown_episodes(output) as on_progress:
        where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress)
        league = play_league(folder, experiment, where, names)
    if settings:
        output.text(f"Settings: {', '.join(settings)}")
    output.block(str(league))
    output.json({"settings": list(settings), **league.to_mapping()})
    if target is not None:
        write_text(target, league.markdown())
        output.text(f"The table is in {target}")
    return INCOMPLETE if league.left_out else 0
