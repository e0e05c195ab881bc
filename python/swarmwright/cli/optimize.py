"""`swarmwright optimize`: evolve a controller."""

from pathlib import Path

import click

from swarmwright.cli._commands import SETTINGS, Command
from swarmwright.cli._evolving import evolve, watch_options
from swarmwright.cli._experiments import experiment_of
from swarmwright.cli._observing import Observing, observe_options
from swarmwright.cli._options import (
    ExistingPath,
    OutputOption,
    Servers,
    WholeNumber,
    experiment_broker,
    experiment_broker_options,
    json_option,
    prefix_settings,
    server_output_option,
    servers_option,
    set_option,
    trust_option,
    wait_option,
)
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "optimize",
    cls=Command,
    instead=SETTINGS,
    example="swarmwright optimize experiments/minisim.yaml --seed 7 --servers 2\n"
    "swarmwright optimize experiments/minisim.yaml --set method.kind=cma_es --set method.generations=30",
)
@click.argument("file", type=ExistingPath(), metavar="FILE")
@experiment_broker_options()
@set_option()
@click.option("--seed", type=WholeNumber(min=0), metavar="S", help="Seed of the run. Default: FILE's.")
@click.option(
    "--out",
    cls=OutputOption,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder for the results. Default: a new one in runs/.",
)
@servers_option
@server_output_option
@wait_option
@watch_options
@observe_options
@trust_option
@json_option
def command(
    file: Path,
    settings: tuple[str, ...],
    broker: str | None,
    prefix: str | None,
    seed: int | None,
    out: Path | None,
    servers: Servers | None,
    wait: float | None,
    tensorboard: Path | None,
    mlflow: str | None,
    log: Path | None,
    log_level: str,
    log_size: int | None,
    metrics: tuple[str, int] | None,
    as_json: bool,
) -> int:
    """Run the experiment in FILE.

    FILE may also be a FREVO session (.zse), converted as by `swarmwright import`.

    Ctrl-C ends the run early and keeps its results; `swarmwright resume` continues it.
    """
    from swarmwright import optimize

    output = Output(as_json=as_json)
    show_warnings()
    experiment = experiment_of(file, (*settings, *prefix_settings(prefix)))
    chosen_servers = servers if servers is not None else experiment.servers
    broker = experiment_broker(broker, experiment.broker, chosen_servers)
    return evolve(
        output,
        experiment,
        lambda on_generation, on_progress: optimize(
            experiment,
            on_generation,
            on_progress=on_progress,
            broker=broker,
            servers=servers,
            wait=wait,
            seed=seed,
            out=out,
        ),
        tensorboard=tensorboard,
        mlflow=mlflow,
        observing=Observing(log, log_level, metrics, log_size),
        broker=broker,
    )
