"""`swarmwright transfer`: what candidates lose in other simulations."""

from pathlib import Path
from typing import Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options


@click.command(
    "transfer",
    cls=Command,
    example="swarmwright transfer runs/minisim-1 --vary parameters.speedDefenders=0.2..0.8\n"
    "swarmwright transfer runs/nnga-* runs/cma-* --to arena-gazebo,stage.yaml --seeds 50 --out transfer.png",
)
@click.argument("runs", type=options.ExistingPath(folder=None), metavar="RUN...", nargs=-1, required=True)
@click.option(
    "--to",
    "targets",
    multiple=True,
    metavar="NAME,..",
    help="Simulations with the same sensors and actuators, or .yaml files with the experiment keys that "
    "differ: simulation, parameters, fitness, servers, broker. Repeatable.",
)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=LOW..HIGH",
    help="Also evaluate in variants of the run's own simulation, with a random value of this parameter "
    "from LOW to HIGH for each seed (pseudo-reality). Repeatable.",
)
@click.option(
    "--pseudo-reality",
    is_flag=True,
    help="Vary the noise of the arena's e-pucks around their reference model: drive 0..0.15, proximity "
    "and ground 0..0.1, light 0..0.9, message loss 0.8..0.95.",
)
@click.option(
    "--candidates",
    type=options.WholeNumber(min=1, max=100_000),
    metavar="K",
    default=10,
    show_default=True,
    help="Number of best candidates of each run, with different controllers.",
)
@click.option(
    "--random",
    type=options.WholeNumber(min=0, max=100_000),
    metavar="K",
    default=0,
    show_default=True,
    help="Number of additional random controllers.",
)
@click.option(
    "--seeds",
    type=options.WholeNumber(min=2, max=1_000_000),
    default=30,
    show_default=True,
    help="Episodes of each candidate in each simulation, on the same held-out seeds.",
)
@options.seed_option(
    "First simulation seed; the others count up. Default: those of the runs' validations; give S for "
    "fresh seeds."
)
@options.file_options(
    "Draw fitness in the other simulation (y) over that in the run's own (x): .png, .svg or .pdf.",
    "Write every episode as a table.",
)
@evaluation_options(
    "Use the servers on this broker where the runs used one, and for simulations that only a server offers. "
    "Default: the runs'.",
    settings=None,
)
def command(
    runs: tuple[Path, ...],
    targets: tuple[str, ...],
    vary: tuple[str, ...],
    picture: Path | None,
    table: Path | None,
    evaluating: Evaluating,
    **chosen: Any,  # noqa: ANN401 - as click passes options
) -> None:
    """Test the best controllers of runs in other simulations.

    The best candidates of each RUN are evaluated there, and the loss of fitness is printed. Runs that differ
    only in the seed form a group; the losses of groups are compared (Mann-Whitney, effect sizes).
    """
    from swarmwright import transfer
    from swarmwright.cli._comparison import run_folders
    from swarmwright.cli._progress import episodes
    from swarmwright.experiment.ranges import Range

    names = [name.strip() for text in targets for name in text.split(",") if name.strip()]
    if not names and not vary and not chosen["pseudo_reality"]:
        raise click.UsageError(
            "nothing to transfer to: name simulations with --to, or parameters with --vary KEY=LOW..HIGH."
        )
    folders, _ = run_folders(runs)
    output = evaluating.output
    with episodes(output) as on_progress:
        result = transfer(
            folders,
            names,
            vary=[Range.parse(text) for text in vary],
            broker=evaluating.broker,
            prefix=evaluating.prefix,
            servers=evaluating.servers,
            on_progress=on_progress,
            **chosen,
        )
    output.block(str(result))
    output.json(result.to_mapping())
    options.write_files(output, result, picture, table)
