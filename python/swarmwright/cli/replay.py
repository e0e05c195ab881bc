"""`swarmwright replay`: watch a candidate of a run."""

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    OutputFile,
    RealNumber,
    SaveOption,
    WholeNumber,
    broker_option,
    candidate_options,
    experiment_broker,
    experiment_prefix_option,
    json_option,
    set_option,
    simulation_option,
    trust_option,
)
from swarmwright.cli._output import Output, results, show_warnings
from swarmwright.core.errors import engine_errors

if TYPE_CHECKING:
    from swarmwright import Run
    from swarmwright.display import Shown
    from swarmwright.runs.replay import Replay


@click.command(
    "replay",
    cls=Command,
    example="swarmwright replay runs/minisim-1 --speed 2\n"
    "swarmwright replay runs/minisim-1 --generation 0 --candidate 7 --save early.gif\n"
    "swarmwright replay runs/minisim-1 --save best.html\n"
    "swarmwright replay runs/line-1 --broker mqtt://lab-3:1883 --save line.html\n"
    "swarmwright replay runs/minisim-1 --beside 0:7 --beside runs/minisim-2 --save several.html",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--save",
    "file",
    cls=SaveOption,
    type=OutputFile(),
    metavar="FILE",
    help="Write a file instead: .html is an interactive page, .gif an animation, .mp4 a video, .png a still "
    "image with all trajectories.",
)
@click.option(
    "--speed",
    type=RealNumber(0.01, 1000.0),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="How many times faster than the simulation's step size.",
)
@click.option(
    "--show",
    "parts",
    metavar="WHAT",
    default="trails,labels",
    show_default=True,
    help="Drawn in addition to bodies, separated by commas: trails, rays (of sensors), links (who hears "
    "whom), labels; or none. On a page it can be changed.",
)
@click.option(
    "--colors",
    type=click.Choice(["auto", "state", "value", "controller"]),
    default="auto",
    show_default=True,
    help="What gives bodies their colours: their kind and state, their value, or the state of the agent's "
    "controller where that is a state machine. A page begins with it.",
)
@click.option(
    "--beside",
    multiple=True,
    metavar="WHICH",
    help="Another candidate on the same page, in the same episode: GENERATION:CANDIDATE of RUN, "
    "or another run's folder, of which the best one is shown in RUN's simulation with RUN's parameters, if "
    "its controllers fit. Can be given several times.",
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
@broker_option(
    default=None,
    text="A server on this broker computes the episode and sends its scenes. Default: this process; for a "
    "simulation that is not here, the run's broker or SWARMWRIGHT_BROKER's.",
)
@experiment_prefix_option("the run's")
@simulation_option
@set_option("Override a value of the run: parameters.maxSteps=40.")
@trust_option
@json_option
def command(
    run: Path,
    file: Path | None,
    speed: float,
    parts: str,
    colors: Literal["auto", "state", "value", "controller"],
    beside: tuple[str, ...],
    generation: int | None,
    candidate: int | None,
    controller: Path | None,
    episode: int | None,
    seed: int | None,
    broker: str | None,
    prefix: str | None,
    simulation: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Watch an episode of a candidate, or save it as a page or film.

    The candidate is the best one of RUN, and parameters and seed are those of the run, unless others are
    given. The simulation runs in this process, or with --broker on a server that sends scenes.
    """
    if controller is not None and (generation is not None or candidate is not None):
        raise click.UsageError(
            "--controller names another controller than the run's; leave it out, or leave out --generation "
            "and --candidate."
        )
    if seed is not None and episode is not None:
        raise click.UsageError("--episode is one of the run's, --seed another one; give one of them.")
    if file is not None:
        _check_file(file)
    if beside and (file is None or file.suffix.lower() != ".html"):
        raise click.UsageError("--beside is shown by a page: --save FILE.html.")
    shown = _shown(parts, colors)
    if file is None:
        _check_unsaved()
    from swarmwright import Run
    from swarmwright.runs.replay import Replay

    output = Output(as_json=as_json)
    show_warnings()
    opened = Run.open(run)
    how: dict[str, Any] = {
        "simulation": simulation,
        "settings": settings,
        "prefix": prefix,
        "broker": _broker(simulation or opened.experiment.simulation, opened, broker),
    }
    replay = Replay.of(
        opened,
        generation=generation,
        candidate=candidate,
        controller=controller,
        episode=episode,
        seed=seed,
        **how,
    )
    if file is not None:
        others = [_beside(replay, which, how) for which in beside]
        _save(output, replay, file, speed, shown, others)
    elif as_json:
        _print_scenes(output, replay)
    else:
        from swarmwright.display.terminal import play

        output.text(replay.title)
        with engine_errors():
            played = replay.episode()
            play(played, results(), in_place=output.terminal, color=output.color, speed=speed)
        output.text(replay.outcome(played.fitness))


def _check_unsaved() -> None:
    """Refuse what is said of a picture where none is made."""
    context = click.get_current_context()
    for name, option in (("parts", "--show"), ("colors", "--colors")):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{option} is for pictures, videos and pages: give --save FILE as well.")


def _broker(simulation: str, run: "Run", broker: str | None) -> str | None:
    """The broker that is named; for a simulation that is not here, also the one of the environment."""
    from swarmwright.simulations import catalogue

    if broker is not None or catalogue.is_here(simulation):
        return broker
    return experiment_broker(None, run.experiment.broker, None)


def _check_file(file: Path) -> None:
    from swarmwright.display.files import FORMATS

    if file.suffix.lower() not in FORMATS:
        raise click.UsageError(f"--save {file}: files end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")


def _shown(parts: str, colors: Literal["auto", "state", "value", "controller"]) -> "Shown":
    from swarmwright.display import PARTS, Shown

    given = [part.strip() for part in parts.split(",") if part.strip()]
    if given == ["none"]:
        given = []
    for part in given:
        if part not in PARTS:
            raise click.UsageError(f"--show: '{part}' found, expected {', '.join(PARTS)} or none.")
    shown = Shown(**{part: part in given for part in PARTS}, colors=colors)
    chosen = click.get_current_context().get_parameter_source("parts") is not ParameterSource.DEFAULT
    return shown if chosen else replace(shown, labels=None)


def _beside(replay: "Replay", which: str, how: dict[str, Any]) -> "Replay":
    """Return what `--beside` names, in the same episode: simulation, parameters and seed of the first one."""
    from swarmwright import Run
    from swarmwright.runs.replay import Replay

    numbers = re.fullmatch(r"(\d{1,18}):(\d{1,18})", which)
    if numbers is not None:
        generation, candidate = int(numbers[1]), int(numbers[2])
        return Replay.of(replay.run, generation=generation, candidate=candidate, seed=replay.seed, **how)
    if not Path(which).is_dir():
        raise click.UsageError(
            f"--beside {which}: expected GENERATION:CANDIDATE such as 0:7, or the folder of a run."
        )
    return replay.beside(Run.open(Path(which)))


def _save(
    output: Output,
    replay: "Replay",
    file: Path,
    speed: float,
    shown: "Shown",
    others: list["Replay"],
) -> None:
    from swarmwright import InputError
    from swarmwright.display import Recording
    from swarmwright.display.files import save
    from swarmwright.display.pictures import PictureRecording
    from swarmwright.display.pictures import save as save_pictures
    from swarmwright.runs.replay import names

    recording: Recording | PictureRecording
    try:
        if replay.pictured:
            if others:
                raise InputError("--beside: this simulation draws pictures, which are shown alone")
            recording = pictures = replay.pictures()
            save_pictures(pictures, file, caption=replay.caption(pictures), speed=speed)
        else:
            recording = scenes = replay.recording()
            called = names([replay, *others]) if others else [""]
            recordings = [scenes, *(other.recording() for other in others)]
            parts = [
                one.part(recorded, name)
                for one, recorded, name in zip([replay, *others], recordings, called, strict=True)
            ]
            save(parts, file, caption=replay.caption(scenes), speed=speed, shown=shown)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror or error}") from error
    output.text(f"{replay.who} {replay.outcome(recording.fitness)} {_what(file)} is in {file}")
    steps = len(recording.fitness_so_far) - 1
    output.json({"fitness": recording.fitness, "steps": steps, "picture": str(file), **replay.identity()})


def _what(file: Path) -> str:
    words = {".html": "The page", ".mp4": "The video", ".gif": "The animation"}
    return words.get(file.suffix.lower(), "The picture")


def _print_scenes(output: Output, replay: "Replay") -> None:
    with engine_errors():
        episode = replay.episode()
        output.json({**episode.scene(), "fitness": episode.fitness})
        while not episode.done:
            episode.step()
            output.json({**episode.scene(), "fitness": episode.fitness})
    output.json({"fitness": episode.fitness, **replay.identity()})
