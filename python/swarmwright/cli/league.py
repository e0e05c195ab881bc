"""`swarmwright league`: a league table of controllers in a folder."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._comparison import INCOMPLETE
from swarmwright.cli._evaluating import Evaluating, evaluation_options


@click.command(
    "league",
    cls=Command,
    example="swarmwright league bundles --experiment soccer.yaml --episodes 30\n"
    "swarmwright league runs --output table.md\n"
    "swarmwright league bundles --seed 1000 --json",
)
@click.argument("folder", type=options.ExistingPath(folder=True), metavar="FOLDER")
@options.experiment_option(
    "Experiment with matches of two sides. Default: FOLDER/league.yaml, if its simulation is built in, or "
    "that of the first run or bundle."
)
@options.episodes_option("Number of episodes of each match.", default=10, most=1_000_000)
@options.seed_option(options.HELD_OUT_SEEDS)
@click.option(
    "--output",
    "target",
    cls=options.OutputOption,
    type=options.OutputFile(),
    metavar="FILE.md",
    help="Write the table as Markdown, too.",
)
@evaluation_options()
def command(
    folder: Path,
    experiment_file: Path | None,
    episodes: int,
    seed: int | None,
    target: Path | None,
    evaluating: Evaluating,
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
    from swarmwright.analysis.league import find_entries, find_experiment, play_league
    from swarmwright.analysis.table import check
    from swarmwright.cli._experiments import experiment_of
    from swarmwright.common.files import write_text

    evaluating.refuse_seed()
    if target is not None:
        check(target, ".md")
    names = find_entries(folder)
    if experiment_file is None:
        experiment = evaluating.change(find_experiment(folder, names))
    else:
        experiment = experiment_of(experiment_file, evaluating.changes)
    with evaluating.episodes(experiment, episodes, seed) as where:
        league = play_league(folder, experiment, where, names)
    evaluating.show(league)
    if target is not None:
        write_text(target, league.markdown())
        evaluating.output.text(f"The table is in {target}")
    return INCOMPLETE if league.left_out else 0
