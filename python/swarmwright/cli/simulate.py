"""`swarmwright simulate`: one episode without optimization."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._experiments import experiment_of
from swarmwright.cli._output import Output
from swarmwright.cli._pictures import PictureOptions, broker_of, picture_options

if TYPE_CHECKING:
    from swarmwright import Experiment
    from swarmwright.servers.evaluation.evaluate import Episode


@click.command(
    "simulate",
    cls=Command,
    example="swarmwright simulate experiments/minisim.yaml --visual\n"
    "swarmwright simulate my.yaml --save my.html\n"
    "swarmwright simulate experiments/minisim.yaml --seed 7 --set parameters.placement=random",
)
@click.argument("file", type=options.ExistingPath())
@options.controller_option("Controller file (best.json) or run folder. Default: a random controller.")
@options.seed_option("Seed of the simulation. Default: parameters.seed, else 0.", most=2**63 - 1)
@picture_options
@click.option("--visual", is_flag=True, help="Ask the server to draw every step.")
@evaluation_options(
    "Use a server on this broker; with --save, one that sends scenes. Default: FILE's, SWARMWRIGHT_BROKER, "
    "or a private one; with --save, this process if it has the simulation.",
    "Override a value of FILE: parameters.maxSteps=30.",
    servers=False,
)
def command(
    file: Path,
    controller: Path | None,
    seed: int | None,
    picture: PictureOptions,
    visual: bool,
    evaluating: Evaluating,
) -> None:
    """Run one episode without optimization, or save it as a page, video or picture.

    FILE is an experiment or a FREVO session (.zse).
    """
    options.exclude("--visual", "--json", "--save")
    options.need("--speed", "--save")
    from swarmwright import Controller
    from swarmwright.servers.evaluation.evaluate import run_episode

    output = evaluating.output
    experiment = experiment_of(file, evaluating.changes)
    if picture.file is not None:
        _save(output, experiment, controller, seed, broker_of(experiment, evaluating.broker), picture)
        picture.open(output)
        return
    loaded = None if controller is None else Controller.load(controller)
    if visual:  # the server's process, which draws, takes the width from its environment
        os.environ["COLUMNS"] = str(shutil.get_terminal_size().columns)
    broker = evaluating.broker_of(experiment)
    result = run_episode(experiment, loaded, broker=broker, visual=visual, seed=seed)
    _print(output, result, controller)


def _save(
    output: Output,
    experiment: "Experiment",
    controller: Path | None,
    seed: int | None,
    broker: str | None,
    picture: PictureOptions,
) -> None:
    from swarmwright.servers.evaluation.evaluate import Episode
    from swarmwright.servers.evaluation.shown import ShownEpisode

    assert picture.file is not None
    episode = ShownEpisode.from_experiment(experiment, controller, seed=seed, broker=broker)
    recording = episode.save(picture.file, speed=picture.speed, shown=picture.shown)
    result = Episode(
        recording.fitness, episode.metrics(recording), episode.controller.parameters, episode.seed
    )
    _print(output, result, controller, picture.describe(recording), picture.saved_message)


def _print(
    output: Output,
    result: "Episode",
    controller: Path | None,
    more: Mapping[str, Any] = MappingProxyType({}),
    sentence: str = "",
) -> None:
    """Print the result. more, sentence: facts on a saved file, for --json and for readers."""
    source = None if controller is None else str(controller)
    output.json(
        {
            "fitness": result.fitness,
            "controller": source,
            "seed": result.seed,
            "parameters": result.parameters,
            "metrics": result.metrics,
            **more,
        }
    )
    random = "random values" if result.parameters else "a random controller"
    output.text(f"Fitness {result.fitness:.6g} with {source or random}. {sentence}".rstrip())
    for values in (result.parameters, result.metrics):
        if values:
            output.text(", ".join(f"{name} {_plain(value)}" for name, value in values.items()))


def _plain(value: float | str) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
