"""`swarmwright optimize`: evolve a controller."""

from functools import partial
from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import SETTINGS, Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._evolving import evolve
from swarmwright.cli._experiments import experiment_of
from swarmwright.cli._observing import ObserverOptions, observe_run_options


@click.command(
    "optimize",
    cls=Command,
    instead=SETTINGS,
    example="swarmwright optimize experiments/minisim.yaml --seed 7 --servers 2\n"
    "swarmwright optimize experiments/minisim.yaml --set method.kind=cma_es --set method.generations=30",
)
@click.argument("file", type=options.ExistingPath())
@options.seed_option("Seed of the run. Default: FILE's.", most=2**63 - 1)
@options.folder_option("Folder for the results. Default: a new one in runs/.")
@options.wait_option
@observe_run_options
@evaluation_options(settings="Override a value of FILE: method.generations=50, 'controller.hidden=[8, 4]'.")
def command(
    file: Path,
    seed: int | None,
    out: Path | None,
    wait: float | None,
    observing: ObserverOptions,
    evaluating: Evaluating,
) -> int:
    """Run the experiment in FILE.

    FILE may also be a FREVO session (.zse), converted as by `swarmwright import`.

    Ctrl-C ends the run early and keeps its results; `swarmwright resume` continues it.
    """
    from swarmwright import optimize

    experiment = experiment_of(file, evaluating.changes)
    broker, servers = evaluating.broker_of(experiment), evaluating.servers
    work = partial(optimize, experiment, broker=broker, servers=servers, wait=wait, seed=seed, out=out)
    return evolve(evaluating.output, experiment, work, observing=observing, broker=broker)
