"""Episodes as files, by the ending of the name."""

import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from swarmwright.display._caption import Caption
from swarmwright.display._episode import Recording

_WRITERS = {".html": "page", ".gif": "animation", ".mp4": "film", ".png": "still"}

FORMATS = tuple(_WRITERS)
"""Endings that `save` knows."""


def save(recording: Recording, path: Path, *, caption: Caption | None = None, speed: float = 1.0) -> None:
    """Write an episode.

    .html is a page to play and step through, .gif and .mp4 move, .png shows all trajectories.

    Args:
        recording: the episode.
        path: is written over.
        caption: the text on the page, and the title of a film; pictures have the simulation's message.
        speed: how many times faster than the simulation's step size it runs, for a page at first.

    Raises:
        ValueError: another ending.
        InputError: a film is wanted and what encodes it is not installed.
        OSError: the file cannot be written.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"'{path}': files end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    write: Callable[..., None] = import_module(f"swarmwright.display.{_WRITERS[ending]}").write
    with warnings.catch_warnings():
        # A message in a script that the font lacks is shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        write(recording, path, caption=caption or Caption(), speed=speed)
