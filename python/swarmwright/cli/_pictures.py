"""Options of commands that save an episode as a picture, page or video, and its display in a browser."""

import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
from click.core import ParameterSource

from swarmwright.cli._options import OutputFile, RealNumber, SaveOption, environment_broker, gather, need
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright import Experiment
    from swarmwright.display import Recording, Shown
    from swarmwright.display.pictures import PictureRecording


PATIENCE_S = 5.0
"""Seconds to wait for a browser that stays in the foreground, before it is left running."""
_PROGRAM = "import sys, webbrowser; sys.exit(not webbrowser.open(sys.argv[1]))"


def has_display() -> bool:
    """Return whether the user would see a window: not in CI, nor over SSH without a display."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) and os.environ.get("CI", "").lower() in {"", "0", "false"}


def open_in_browser(file: Path) -> bool:
    """Open a file in a browser; return False if that is not possible, for example without a display.

    `webbrowser` runs in a separate process without this terminal: browsers print warnings, some stay in the
    foreground, and text browsers would take over the terminal. Ctrl-C does not close the browser.
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
            process.returncode = 0  # keeps Python from warning about a running process
            return True
    return False


class PictureOptions(NamedTuple):
    """Options of a command that shows an episode: the file for it, or None, and what it shows."""

    file: Path | None
    open_browser: bool
    speed: float
    shown: "Shown"

    def describe(self, recording: "Recording | PictureRecording") -> dict[str, Any]:
        """Return the facts of a written recording for `--json`."""
        steps = len(recording.fitness_so_far) - 1
        return {"fitness": recording.fitness, "steps": steps, "picture": str(self.file)}

    @property
    def saved_message(self) -> str:
        """The kind and path of the written file."""
        assert self.file is not None
        words = {".html": "The page", ".mp4": "The video", ".gif": "The animation"}
        return f"{words.get(self.file.suffix.lower(), 'The picture')} is in {self.file}"

    def open(self, output: Output) -> None:
        """Open the file in a browser, if that was requested; print its address."""
        if self.file is None or not self.open_browser:
            return
        address = self.file.absolute().as_uri()
        if open_in_browser(self.file):
            output.text(f"Opening it in the browser. If no window appears: {address}")
        else:
            output.text(f"Open it in a browser: {address}")


def _gather_picture(
    picture: Path | None, open_browser: bool, speed: float, parts: str, colors: str
) -> "dict[str, PictureOptions]":
    for option in ("--open", "--show", "--colors"):
        need(option, "--save")
    if picture is not None:
        _check_file(picture)
    return {"picture": PictureOptions(picture, open_browser, speed, _parse_parts(parts, colors))}


picture_options = gather(
    _gather_picture,
    click.option(
        "--save",
        "picture",
        cls=SaveOption,
        type=OutputFile(),
        help="Write the episode to a file: .html is an interactive page, .gif an animation, .mp4 a video, "
        ".png a still image with trajectories.",
    ),
    click.option(
        "--open",
        "open_browser",
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
"""`--save`, `--open`, `--speed`, `--show` and `--colors`; the command gets `picture`, a `PictureOptions`."""


def broker_of(experiment: "Experiment", broker: str | None, simulation: str | None = None) -> str | None:
    """Return the broker on which to compute an episode; None for this process.

    For a simulation that this process lacks, the experiment's broker or the environment's is the default.
    Unlike `options.experiment_broker`, this ignores `servers`: `servers: local` does not apply to a single
    episode.
    simulation: replaces the experiment's.
    """
    from swarmwright.simulations import catalogue

    if broker is not None or catalogue.is_local(simulation or experiment.simulation):
        return broker
    return environment_broker() if experiment.broker is None else None


def _check_file(picture: Path) -> None:
    """Refuse a file with an unknown ending."""
    from swarmwright.display.files import FORMATS

    if picture.suffix.lower() not in FORMATS:
        endings = f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        raise click.UsageError(f"--save {picture}: files end with {endings}.")


def _parse_parts(parts: str, colors: Any) -> "Shown":  # noqa: ANN401 - one of its colours
    """Parse `--show` and `--colors`."""
    from swarmwright.display import PARTS, Shown

    names = [part.strip() for part in parts.split(",") if part.strip()]
    if names == ["none"]:
        names = []
    for part in names:
        if part not in PARTS:
            raise click.UsageError(f"--show: '{part}' is not a part; choose from {', '.join(PARTS)} or none.")
    shown = Shown(**{part: part in names for part in PARTS}, colors=colors)
    chosen = click.get_current_context().get_parameter_source("parts") is not ParameterSource.DEFAULT
    return shown if chosen else replace(shown, labels=None)
