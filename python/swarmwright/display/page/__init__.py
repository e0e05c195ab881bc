"""Episodes as one self-contained page (HTML): play, step, scrub, zoom, follow an agent; without a network."""

import html
import json
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.display._episode import Caption, Part, Recording, Shown
from swarmwright.display._look import Looks, css
from swarmwright.display.page._data import page_data, picture_data

if TYPE_CHECKING:
    from swarmwright.display.pictures import PictureRecording

SCRIPTS = (
    "shapes.js", "series.js", "camera.js", "ground.js", "signals.js", "sprites.js", "world.js", "pictures.js",
    "curve.js", "legend.js", "machine.js", "tree.js", "inspector.js", "player.js",
)  # fmt: skip
"""In this order they are one script."""


def page(
    shows: Recording | Sequence[Part],
    *,
    caption: Caption,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> str:
    """Return the page: one HTML document that needs nothing else.

    shows: an episode, or several beside each other. speed: how many times faster than the simulation's step
    size it plays at first. shown: what is drawn at first.
    """
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    data, looks = page_data(parts, speed=speed, shown=shown or Shown())
    return _filled(data, caption, looks)


def write_pictures(
    recording: "PictureRecording", path: Path, *, caption: Caption, speed: float = 1.0
) -> None:
    """Write the page of an episode in pictures. Raises OSError."""
    path.write_text(_filled(picture_data(recording, speed=speed), caption, Looks(())), encoding="utf-8")


def _filled(data: dict[str, Any], caption: Caption, looks: Looks) -> str:
    """Return the page with an episode as its script reads it."""
    title = caption.title or str(data["episodes"][0]["message"]) or "Episode"
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
        "style": f"{css(looks.own)}\n{_part('page.css')}",
        "script": "\n".join(_part(name) for name in SCRIPTS),
        "episode": text,
    }
    # In one pass: placeholders within inserted parts are not replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _part("page.html"))


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
