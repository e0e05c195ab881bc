"""`swarmwright replay`: watch the best controller of a run."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright.display import Playable


@click.command(
    "replay",
    cls=Command,
    example="swarmwright replay runs/minisim-1 --speed 2\nswarmwright replay runs/minisim-1 --save best.gif",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--save",
    "picture",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write a picture instead: .gif moves, .png shows all trajectories.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 1000.0),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="How many times faster than the simulation's step size.",
)
@click.option(
    "--controller",
    type=ExistingPath(folder=None),
    metavar="C",
    help="Another controller than the run's best: a file or a run folder.",
)
@click.option(
    "--episode",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="E",
    help="Which episode's seed.",
)
@json_option
def command(
    run: Path, picture: Path | None, speed: float, controller: Path | None, episode: int, as_json: bool
) -> None:
    """Show the best controller of RUN at work.

    The simulation runs in this process, with the parameters and the seed that the run used.
    """
    if picture is not None:
        _check_picture(picture)
    from swarmwright import Controller, Run, _engine

    output = Output(as_json=as_json)
    opened = Run.open(run)
    experiment = opened.experiment
    title = experiment.simulation
    if title not in _engine.simulations():
        raise click.UsageError(
            f"{run}: the simulation '{title}' is not built in, so it cannot be shown here. Its servers can: "
            f"swarmwright simulate {run / 'experiment.yaml'} --controller {run} --visual"
        )
    chosen = opened.best.controller if controller is None else Controller.load(controller)
    parameters: dict[str, object] = {**experiment.parameters, "seed": experiment.first_seed + episode}
    played = _engine.Episode(title, json.dumps(parameters), chosen.json)
    if picture is not None:
        _save(output, played, picture, speed)
    elif as_json:
        _print_scenes(output, played)
    else:
        from swarmwright.display.terminal import play

        play(played, sys.stdout, in_place=output.terminal, color=output.color, speed=speed)
        output.text(f"Fitness {played.fitness + 0.0:.6g}.")


def _check_picture(picture: Path) -> None:
    from swarmwright.display.animation import FORMATS

    if picture.suffix.lower() not in FORMATS:
        raise click.UsageError(f"--save {picture}: pictures end with {' or '.join(FORMATS)}.")
    if not picture.parent.is_dir():
        raise click.UsageError(f"--save {picture}: there is no folder '{picture.parent}'; create it first.")


def _save(output: Output, episode: "Playable", picture: Path, speed: float) -> None:
    from swarmwright.display import record
    from swarmwright.display.animation import save

    recording = record(episode)
    save(recording, picture, speed=speed)
    output.text(f"Fitness {recording.fitness + 0.0:.6g}. The picture is in {picture}")
    output.json({"fitness": recording.fitness, "steps": len(recording.scenes) - 1, "picture": str(picture)})


def _print_scenes(output: Output, episode: "Playable") -> None:
    output.json(json.loads(episode.scene()))
    while not episode.done:
        episode.step()
        output.json(json.loads(episode.scene()))
    output.json({"fitness": episode.fitness})
