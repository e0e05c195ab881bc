"""An episode as one self-contained page (HTML): play, pause, step, scrub; from a file, without a network."""

import html
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.display._caption import Caption
from swarmwright.display._episode import Recording
from swarmwright.display._look import css
from swarmwright.display.page._data import episode_data, picture_data

if TYPE_CHECKING:
    from swarmwright.display.pictures import PictureRecording

SCRIPTS = ("shapes.js", "world.js", "pictures.js", "curve.js", "player.js")
"""In this order they are one script."""


def write(recording: Recording, path: Path, *, caption: Caption, speed: float = 1.0) -> None:
    """Write the page. Raises OSError."""
    path.write_text(page(recording, caption=caption, speed=speed), encoding="utf-8")


def page(recording: Recording, *, caption: Caption, speed: float = 1.0) -> str:
    """Return the page: one HTML document that needs nothing else.

    speed: how many times faster than the simulation's step size it plays at first.
    """
    return _filled(episode_data(recording, speed=speed), caption)


def write_pictures(
    recording: "PictureRecording", path: Path, *, caption: Caption, speed: float = 1.0
) -> None:
    """Write the page of an episode in pictures. Raises OSError."""
    path.write_text(_filled(picture_data(recording, speed=speed), caption), encoding="utf-8")


def _filled(data: dict[str, Any], caption: Caption) -> str:
    """Return the page with an episode as its script reads it."""
    title = caption.title or str(data["message"]) or "Episode"
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in caption.facts
    )
    # A text of the simulation must not end the script that contains it.
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace(
        "<", "\\u003c"
    )
    parts = {
        "title": html.escape(title),
        "facts": facts,
        "style": f"{css()}\n{_part('page.css')}",
        "script": "\n".join(_part(name) for name in SCRIPTS),
        "episode": text,
    }
    # In one pass: placeholders within inserted parts are not replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _part("page.html"))


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
