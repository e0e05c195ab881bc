"""Options of commands that save an episode as a picture, page or video, and what opens them."""

import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from swarmwright.cli._options import OutputFile, RealNumber, SaveOption, combine_options, experiment_broker
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright.display import Recording, Shown
    from swarmwright.display.pictures import PictureRecording


PATIENCE_S = 5.0
"""Seconds to wait for a browser that stays in the foreground; it is left running."""
_PROGRAM = "import sys, webbrowser; sys.exit(not webbrowser.open(sys.argv[1]))"


def has_display() -> bool:
    """Whether a person would see a window of this process: not in CI, nor over SSH without a display."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) and os.environ.get("CI", "").lower() in {"", "0", "false"}


def open_in_browser(file: Path) -> bool:
    """Open a file in a browser, where there is a display; return False where that is not possible.

    `webbrowser` runs in a process of its own without this terminal: browsers print warnings, some of them
    stay in the foreground, and browsers for text would take the terminal. Ctrl-C does not close the browser.
    """
    if not has_display():
        return False
    environment = {name: value for name, value in os.environ.items() if name != "TERM"}
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, "-I", "-c", _PROGRAM, file.absolute().as_uri()],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(PATIENCE_S) == 0
        except subprocess.TimeoutExpired:
            process.returncode = 0  # not ours to wait for: without this, Python would warn of it
            return True
    return False


Colors = Literal["auto", "state", "value", "controller"]

picture_options = combine_options(
    click.option(
        "--save",
        "picture",
        cls=SaveOption,
        type=OutputFile(),
        metavar="FILE",
        help="Write the episode to a file: .html is an interactive page, .gif an animation, .mp4 a video, "
        ".png a still image with trajectories.",
    ),
    click.option(
        "--open",
        "opening",
        is_flag=True,
        help="With --save: open the file in a browser, if there is a display.",
    ),
    click.option(
        "--speed",
        type=RealNumber(0.01, 1000.0),
        default=1.0,
        show_default=True,
        metavar="FACTOR",
        help="Playback speed as a multiple of simulated time.",
    ),
    click.option(
        "--show",
        "parts",
        metavar="WHAT",
        default="trails,labels",
        show_default=True,
        help="Comma-separated parts to draw besides bodies: trails, rays (of sensors), links (who hears "
        "whom), labels; or none.",
    ),
    click.option(
        "--colors",
        type=click.Choice(["auto", "state", "value", "controller"]),
        default="auto",
        show_default=True,
        help="Colour bodies by kind and state, by value, or by the state of their controller's state "
        "machine.",
    ),
)
"""`--save`, `--open`, `--speed`, `--show` and `--colors`.

The command gets `picture`, `opening`, `speed`, `parts` and `colors`.
"""


def check_unsaved(options: Mapping[str, str]) -> None:
    """Refuse what is said of a picture where none is made. options: parameter -> name on the command line."""
    context = click.get_current_context()
    for name, option in options.items():
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{option} is for pictures, videos and pages: give --save FILE as well.")


def broker_of(simulation: str, broker: str | None, of_experiment: str | None) -> str | None:
    """Return where an episode is computed that is shown here; None for this process.

    That is the broker that is named; for a simulation that is not here, also the experiment's or the one of
    the environment.
    """
    from swarmwright.simulations import catalogue

    if broker is not None or catalogue.is_local(simulation):
        return broker
    return experiment_broker(None, of_experiment, None)


def check_file(picture: Path) -> None:
    """Refuse a file whose ending stands for no format."""
    from swarmwright.display.files import FORMATS

    if picture.suffix.lower() not in FORMATS:
        endings = f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        raise click.UsageError(f"--save {picture}: files end with {endings}.")


def shown_parts(parts: str, colors: Colors) -> "Shown":
    """Return what `--show` and `--colors` say is drawn."""
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


def where(picture: Path) -> str:
    """Say what was written, and into which file."""
    words = {".html": "The page", ".mp4": "The video", ".gif": "The animation"}
    return f"{words.get(picture.suffix.lower(), 'The picture')} is in {picture}"


def saved(recording: "Recording | PictureRecording", picture: Path) -> dict[str, Any]:
    """Return what was written as plain values, for `--json`."""
    steps = len(recording.fitness_so_far) - 1
    return {"fitness": recording.fitness, "steps": steps, "picture": str(picture)}


def show_in_browser(output: Output, picture: Path) -> None:
    """Open a file in a browser, and say so; where that is not possible, say where a browser finds it."""
    address = picture.absolute().as_uri()
    if open_in_browser(picture):
        output.text(f"Opening it in the browser. If no window appears: {address}")
    else:
        output.text(f"Open it in a browser: {address}")
