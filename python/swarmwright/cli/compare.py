"""`swarmwright compare`: two controllers in the same episodes."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "compare",
    cls=Command,
    example="swarmwright compare runs/cma-1 runs/nnga-1\n"
    "swarmwright compare runs/minisim-1 runs/minisim-1:3:12 --episodes 500\n"
    "swarmwright compare runs/minisim-1 mine.json --out comparison.pdf --csv episodes.csv\n"
    "swarmwright compare controller.json mine.json --experiment minisim.yaml --json",
)
@click.argument("first", type=options.controller_or_candidate, metavar="A")
@click.argument("second", type=options.controller_or_candidate, metavar="B")
@click.option(
    "--experiment",
    "experiment_file",
    type=options.ExistingPath(folder=False),
    help="Experiment for both controllers. Default: A's, or B's if A is not a run.",
)
@click.option(
    "--episodes",
    type=options.WholeNumber(min=1, max=10_000_000),
    default=100,
    show_default=True,
    help="Number of episodes.",
)
@options.seed_option(
    "Simulation seed of the first episode; the others count up. Default: held-out seeds that neither "
    "run used."
)
@options.set_option("Override a value of the experiment: parameters.maxSteps=40, ranking.failed=0.")
@options.episodes_options(
    "Draw the episodes of both and their differences: .png, .svg or .pdf.",
    "Write every episode as a table: seed, first, second, difference.",
)
@options.evaluation_options()
def command(
    first: str,
    second: str,
    experiment_file: Path | None,
    episodes: int,
    seed: int | None,
    settings: tuple[str, ...],
    picture: Path | None,
    table: Path | None,
    broker: str | None,
    prefix: str | None,
    servers: options.Servers | None,
    output: Output,
) -> None:
    """Compare two controllers in the same episodes.

    A and B are each a run folder (its best candidate), a candidate RUN:GENERATION:CANDIDATE, or a controller
    file (JSON, or YAML of a machine). Both are evaluated on the same seeds. The output is the mean
    difference with its 95 % confidence interval (Student's t), Wilcoxon's signed-rank test and its effect
    size.

    If a controller fails in an episode, the pair is excluded and the result is not reportable, unless
    ranking.failed gives failures a fitness.

    `swarmwright runs compare` compares methods; `swarmwright evaluate --controller` evaluates one
    controller.
    """
    from swarmwright.analysis.paired import Match
    from swarmwright.cli._experiments import experiment_of
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.cli.evaluate import NOT_EVALUATED, settable
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.post_evaluation import EvaluationOptions

    show_warnings()
    refuse_seed(settings)
    changed = (*settings, *options.prefix_settings(prefix))
    if experiment_file is None:
        match = Match.of(first, second, None)
        experiment = match.experiment.with_settings(changed, only=settable(), reason=NOT_EVALUATED)
        match = match._replace(experiment=experiment)
    else:
        match = Match.of(first, second, experiment_of(experiment_file, changed))
        experiment = match.experiment
    broker = options.experiment_broker(experiment, broker, servers)
    with shown_episodes(output) as on_progress:
        comparison = match.evaluate(EvaluationOptions.of(episodes, seed, broker, servers, on_progress))
    if settings:
        output.text(f"Settings: {', '.join(settings)}")
    output.block(str(comparison))
    output.json({"settings": list(settings), **comparison.to_mapping()})
    options.write_episodes(output, comparison, picture, table)
