"""`swarmwright simulate`: one episode without optimization."""

import os
import shutil
from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._experiments import experiment_of
from swarmwright.cli._options import (
    ExistingPath,
    WholeNumber,
    broker_option,
    experiment_broker,
    experiment_prefix_option,
    json_option,
    prefix_settings,
    set_option,
    trust_option,
)
from swarmwright.cli._output import Output, show_warnings
from swarmwright.cli._server_output import server_output_option


@click.command(
    "simulate",
    cls=Command,
    example="swarmwright simulate experiments/minisim.yaml --visual\n"
    "swarmwright simulate experiments/minisim.yaml --seed 7 --set parameters.placement=random",
)
@click.argument("file", type=ExistingPath(), metavar="FILE")
@click.option(
    "--controller",
    type=ExistingPath(folder=None),
    metavar="C",
    help="A controller (best.json) or a run folder. Default: a random one.",
)
@set_option("Override a value of FILE: parameters.maxSteps=30.")
@click.option(
    "--seed",
    type=WholeNumber(min=0, max=2**63 - 1),
    metavar="S",
    help="Seed of the simulation. Default: parameters.seed, else 0.",
)
@broker_option(
    default=None,
    text="Use a server on this broker. Default: FILE's, SWARMWRIGHT_BROKER's, or one started here.",
)
@experiment_prefix_option("FILE's")
@click.option("--visual", is_flag=True, help="Ask the server to draw the episode, a frame every step.")
@server_output_option
@trust_option
@json_option
def command(
    file: Path,
    controller: Path | None,
    settings: tuple[str, ...],
    seed: int | None,
    broker: str | None,
    prefix: str | None,
    visual: bool,
    as_json: bool,
) -> None:
    """Run one episode, without optimization.

    FILE is an experiment, or a session of FREVO (.zse), whose simulation is run once.
    """
    if visual and as_json:
        raise click.UsageError("--visual draws where --json prints; give one of them.")
    from swarmwright import Controller
    from swarmwright.evaluation.evaluate import episode

    output = Output(as_json=as_json)
    show_warnings()
    experiment = experiment_of(file, (*settings, *prefix_settings(prefix)))
    loaded = None if controller is None else Controller.load(controller)
    if visual:  # the server's process, which draws, takes the width from its environment
        os.environ["COLUMNS"] = str(shutil.get_terminal_size().columns)
    broker = experiment_broker(broker, experiment.broker, experiment.servers)
    result = episode(experiment, loaded, broker=broker, visual=visual, seed=seed)
    whose = None if controller is None else str(controller)
    output.json(
        {
            "fitness": result.fitness,
            "controller": whose,
            "seed": result.seed,
            "parameters": result.parameters,
            "metrics": result.metrics,
        }
    )
    random = "random values" if result.parameters else "a random controller"
    output.text(f"Fitness {result.fitness:.6g} with {whose or random}.")
    for values in (result.parameters, result.metrics):
        if values:
            output.text(", ".join(f"{name} {_plain(value)}" for name, value in values.items()))


def _plain(value: float | str) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
