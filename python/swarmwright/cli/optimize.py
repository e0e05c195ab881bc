"""`swarmwright optimize`: evolve a controller."""

from functools import partial
from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import SETTINGS, Command
from swarmwright.cli._evolving import evolve, watch_options
from swarmwright.cli._experiments import experiment_of
from swarmwright.cli._observing import ObserverOptions, observe_options
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "optimize",
    cls=Command,
    instead=SETTINGS,
    example="swarmwright optimize experiments/minisim.yaml --seed 7 --servers 2\n"
    "swarmwright optimize experiments/minisim.yaml --set method.kind=cma_es --set method.generations=30",
)
@click.argument("file", type=options.ExistingPath())
@options.experiment_broker_options()
@options.set_option()
@click.option(
    "--seed", type=options.WholeNumber(min=0), metavar="S", help="Seed of the run. Default: FILE's."
)
@click.option(
    "--out",
    cls=options.OutputOption,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder for the results. Default: a new one in runs/.",
)
@options.servers_option
@options.server_output_option
@options.wait_option
@watch_options
@observe_options
@options.trust_option
@options.json_option
def command(
    file: Path,
    settings: tuple[str, ...],
    broker: str | None,
    prefix: str | None,
    seed: int | None,
    out: Path | None,
    servers: options.Servers | None,
    wait: float | None,
    observing: ObserverOptions,
    output: Output,
) -> int:
    """Run the experiment in FILE.

    FILE may also be a FREVO session (.zse), converted as by `swarmwright import`.

    Ctrl-C ends the run early and keeps its results; `swarmwright resume` continues it.
    """
    from swarmwright import optimize

    show_warnings()
    experiment = experiment_of(file, (*settings, *options.prefix_settings(prefix)))
    broker = options.experiment_broker(experiment, broker, servers)
    return evolve(
        output,
        experiment,
        partial(optimize, experiment, broker=broker, servers=servers, wait=wait, seed=seed, out=out),
        observing=observing,
        broker=broker,
    )
