"""`swarmwright compare`: two controllers in the same episodes."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options


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
@options.experiment_option("Experiment for both controllers. Default: A's, or B's if A is not a run.")
@options.episodes_option("Number of episodes.", default=100)
@options.seed_option(options.HELD_OUT_SEEDS)
@options.file_options(
    "Draw the episodes of both and their differences: .png, .svg or .pdf.",
    "Write every episode as a table: seed, first, second, difference.",
)
@evaluation_options(settings="Override a value of the experiment: parameters.maxSteps=40, ranking.failed=0.")
def command(
    first: str,
    second: str,
    experiment_file: Path | None,
    episodes: int,
    seed: int | None,
    picture: Path | None,
    table: Path | None,
    evaluating: Evaluating,
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

    evaluating.refuse_seed()
    if experiment_file is None:
        match = Match.of(first, second, None)
        match = match._replace(experiment=evaluating.change(match.experiment))
    else:
        match = Match.of(first, second, experiment_of(experiment_file, evaluating.changes))
    with evaluating.episodes(match.experiment, episodes, seed) as where:
        comparison = match.evaluate(where)
    evaluating.show(comparison)
    options.write_files(evaluating.output, comparison, picture, table)
