"""`swarmwright replay`: watch a candidate of a run."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    WholeNumber,
    candidate_options,
    json_option,
    set_option,
    simulation_option,
    trust_option,
)
from swarmwright.cli._output import Output, show_warnings

if TYPE_CHECKING:
    from swarmwright.runs.replay import Replay


@click.command(
    "replay",
    cls=Command,
    example="swarmwright replay runs/minisim-1 --speed 2\n"
    "swarmwright replay runs/minisim-1 --generation 0 --candidate 7 --save early.gif\n"
    "swarmwright replay runs/minisim-1 --save best.html",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--save",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write a file instead: .html is a page to play and step through, .gif and .mp4 move, .png shows all "
    "trajectories.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 1000.0),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="How many times faster than the simulation's step size.",
)
@candidate_options
@click.option(
    "--controller",
    type=ExistingPath(folder=None),
    metavar="C",
    help="Another controller than the run's: a file or a run folder.",
)
@click.option(
    "--episode",
    type=WholeNumber(min=0),
    metavar="E",
    help="Which of the run's episodes, from 0. Default: 0.",
)
@click.option(
    "--seed",
    type=WholeNumber(min=0),
    metavar="S",
    help="An episode that the run did not have: the simulation's seed.",
)
@simulation_option
@set_option("Override a value of the run: parameters.maxSteps=40.")
@trust_option
@json_option
def command(
    run: Path,
    file: Path | None,
    speed: float,
    generation: int | None,
    candidate: int | None,
    controller: Path | None,
    episode: int | None,
    seed: int | None,
    simulation: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Show a candidate of RUN at work, the best one unless another is named.

    The simulation runs in this process, with the parameters and the seed that the run used, unless others
    are given.
    """
    if controller is not None and (generation is not None or candidate is not None):
        raise click.UsageError(
            "--controller names another controller than the run's; leave it or the others."
        )
    if seed is not None and episode is not None:
        raise click.UsageError("--episode is one of the run's, --seed another one; give one of them.")
    if file is not None:
        _check_file(file)
    from swarmwright import Run
    from swarmwright.runs.replay import Replay

    output = Output(as_json=as_json)
    show_warnings()
    replay = Replay.of(
        Run.open(run),
        generation=generation,
        candidate=candidate,
        controller=controller,
        episode=episode,
        seed=seed,
        simulation=simulation,
        settings=settings,
    )
    if file is not None:
        _save(output, replay, file, speed)
    elif as_json:
        _print_scenes(output, replay)
    else:
        from swarmwright.display.terminal import play

        output.text(replay.title)
        played = replay.episode()
        play(played, sys.stdout, in_place=output.terminal, color=output.color, speed=speed)
        output.text(replay.outcome(played.fitness))


def _check_file(file: Path) -> None:
    from swarmwright.display.files import FORMATS

    if file.suffix.lower() not in FORMATS:
        raise click.UsageError(f"--save {file}: files end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    if not file.parent.is_dir():
        raise click.UsageError(f"--save {file}: there is no folder '{file.parent}'; create it first.")


def _save(output: Output, replay: "Replay", file: Path, speed: float) -> None:
    from swarmwright import InputError
    from swarmwright.display import Recording, record
    from swarmwright.display.files import save
    from swarmwright.display.pictures import PictureRecording
    from swarmwright.display.pictures import save as save_pictures

    recording: Recording | PictureRecording
    try:
        if replay.pictured:
            recording = pictures = replay.pictures()
            save_pictures(pictures, file, caption=replay.caption(), speed=speed)
        else:
            recording = scenes = record(replay.episode())
            save(scenes, file, caption=replay.caption(), speed=speed)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror or error}") from error
    output.text(f"{replay.outcome(recording.fitness)} {_what(file)} is in {file}")
    steps = len(recording.fitness_so_far) - 1
    output.json({"fitness": recording.fitness, "steps": steps, "picture": str(file), **replay.identity()})


def _what(file: Path) -> str:
    return {".html": "The page", ".mp4": "The film"}.get(file.suffix.lower(), "The picture")


def _print_scenes(output: Output, replay: "Replay") -> None:
    episode = replay.episode()
    output.json({**episode.scene(), "fitness": episode.fitness})
    while not episode.done:
        episode.step()
        output.json({**episode.scene(), "fitness": episode.fitness})
    output.json({"fitness": episode.fitness, **replay.identity()})
