"""`swarmwright replay`: watch a candidate of a run."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._output import Output, get_stdout
from swarmwright.cli._pictures import PictureOptions, broker_of, picture_options
from swarmwright.common.errors import engine_errors

if TYPE_CHECKING:
    from swarmwright.runs.replay import Replay

_BEFORE_A_RUN = (
    "that of a run; to look at an experiment before any run, use 'swarmwright simulate FILE --save PAGE'"
)


def _read_match(_context: click.Context, _option: click.Parameter, text: str | None) -> tuple[int, ...]:
    """Return the generations of `--match`."""
    if text is None:
        return ()
    if re.fullmatch(r"\d{1,18}(,\d{1,18})+", text, re.ASCII) is None:
        raise click.BadParameter(f"{text!r} is not a list of generations such as 40,3.")
    return tuple(map(int, text.split(",")))


@click.command(
    "replay",
    cls=Command,
    example="swarmwright replay runs/minisim-1 --speed 2\n"
    "swarmwright replay runs/minisim-1 --generation 0 --candidate 7 --save early.gif\n"
    "swarmwright replay runs/minisim-1 --save best.html --open\n"
    "swarmwright replay runs/pursuit-1 --match 40,3 --save match.html\n"
    "swarmwright replay runs/line-1 --broker mqtt://lab-3:1883 --save line.html\n"
    "swarmwright replay runs/minisim-1 --beside 0:7 --beside runs/minisim-2 --save several.html",
)
@click.argument("run", type=options.ExistingPath(folder=True, for_experiment=_BEFORE_A_RUN))
@picture_options
@click.option(
    "--beside",
    multiple=True,
    metavar="WHICH",
    help="Show another candidate in the same episode on the page: GENERATION:CANDIDATE of RUN, or the "
    "best of another run folder. Repeatable.",
)
@options.candidate_options
@options.controller_option("Replay this controller file or run folder instead of a candidate of RUN.")
@click.option(
    "--match",
    "match",
    metavar="G1,G2",
    callback=_read_match,
    help="Replay the match of champions of a competition: the generation of each side's, in the order of the "
    "sides.",
)
@click.option(
    "--episode",
    type=options.WholeNumber(min=0),
    metavar="E",
    help="Episode of the run, counted from 0; of a match, as `progress` counts. Default: 0.",
)
@options.seed_option("Simulation seed of a new episode.", most=2**63 - 1)
@options.simulation_option
@evaluation_options(
    "Compute the episode on a server that sends scenes. Default: this process, or if it lacks the "
    "simulation, the run's broker or SWARMWRIGHT_BROKER.",
    "Override a value of the run: parameters.maxSteps=40.",
    servers=False,
    server_output=False,
)
def command(
    run: Path,
    picture: PictureOptions,
    beside: tuple[str, ...],
    generation: int | None,
    candidate: int | None,
    controller: Path | None,
    match: tuple[int, ...],
    episode: int | None,
    seed: int | None,
    simulation: str | None,
    evaluating: Evaluating,
) -> None:
    """Watch an episode of a candidate, or save it as a page or film.

    By default, the best candidate of RUN is replayed in this process, with the parameters and seed of the
    run.
    """
    options.exclude("--controller", "--match", "--generation", "--candidate")
    options.exclude("--match", "--generation", "--candidate")
    options.exclude("--episode", "--seed")
    if beside and (picture.file is None or picture.file.suffix.lower() != ".html"):
        raise click.UsageError("--beside needs a page: --save FILE.html.")
    from swarmwright import Run
    from swarmwright.runs.replay import Replay

    opened, output = Run.open(run), evaluating.output
    how: dict[str, Any] = {
        "simulation": simulation,
        "settings": evaluating.settings,
        "prefix": evaluating.prefix,
        "broker": broker_of(opened.experiment, evaluating.broker, simulation),
    }
    replay = Replay.of(
        opened,
        generation=generation,
        candidate=candidate,
        controller=controller,
        match=match,
        episode=episode,
        seed=seed,
        **how,
    )
    if picture.file is not None:
        _save(output, replay, picture, [_replay_beside(replay, name, how) for name in beside])
        picture.open(output)
    elif output.as_json:
        _print_scenes(output, replay)
    else:
        from swarmwright.display.terminal import play

        output.text(replay.title)
        with engine_errors():
            played = replay.episode()
            play(played, get_stdout(), in_place=output.terminal, color=output.color, speed=picture.speed)
        output.text(replay.outcome(played.fitness))


def _replay_beside(replay: "Replay", name: str, how: dict[str, Any]) -> "Replay":
    """Return a replay for `--beside` in the same episode: simulation, parameters and seed of the first."""
    from swarmwright import Run
    from swarmwright.runs.replay import Replay

    numbers = re.fullmatch(r"(\d{1,18}):(\d{1,18})", name)
    if numbers is not None:
        generation, candidate = int(numbers[1]), int(numbers[2])
        return Replay.of(replay.run, generation=generation, candidate=candidate, seed=replay.seed, **how)
    if not Path(name).is_dir():
        raise click.UsageError(
            f"--beside {name}: expected GENERATION:CANDIDATE such as 0:7, or the folder of a run."
        )
    return replay.with_best_of(Run.open(Path(name)))


def _save(output: Output, replay: "Replay", picture: PictureOptions, others: list["Replay"]) -> None:
    from swarmwright.runs.replay import name_replays

    assert picture.file is not None
    names = name_replays([replay, *others]) if others else [""]
    recording = replay.save(
        picture.file, speed=picture.speed, shown=picture.shown, companions=others, names=names
    )
    output.text(f"{replay.controller_sentence} {replay.outcome(recording.fitness)} {picture.saved_message}")
    output.json({**picture.describe(recording), **replay.identity()})


def _print_scenes(output: Output, replay: "Replay") -> None:
    with engine_errors():
        episode = replay.episode()
        output.json({**episode.scene(), "fitness": episode.fitness})
        while not episode.done:
            episode.step()
            output.json({**episode.scene(), "fitness": episode.fitness})
    output.json({"fitness": episode.fitness, **replay.identity()})
