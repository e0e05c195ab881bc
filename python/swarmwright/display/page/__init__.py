"""Episodes as a self-contained HTML page: play, step, scrub, zoom, follow an agent; works offline.

A page around it can play several in step: see `remote.js` for the messages. `format_player` has no episode;
the page around it sends one, packed by `pack_page`, which is shown faster than a page of its own.
"""

import html
import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.display._episode import Caption, Part, Recording, Shown
from swarmwright.display._look import Looks, format_css
from swarmwright.display.page._data import TABLES, page_data, picture_data
from swarmwright.display.page._packing import to_bytes, to_json

if TYPE_CHECKING:
    from swarmwright.display.pictures import PictureRecording

SCRIPTS = (
    "shapes.js", "series.js", "camera.js", "ground.js", "signals.js", "sprites.js", "world.js", "pictures.js",
    "curve.js", "legend.js", "machine.js", "tree.js", "inspector.js", "player.js", "remote.js",
)  # fmt: skip
"""Parts of the script, in order."""


def format_page(
    shows: Recording | Sequence[Part],
    *,
    caption: Caption,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> str:
    """Return the page, a self-contained HTML document.

    shows: an episode, or several side by side. speed: initial factor relative to the simulation's step size.
    shown: optional parts that are shown initially.
    """
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    data, looks = page_data(parts, speed=speed, shown=shown or Shown())
    return _fill_template(data, caption, looks)


def pack_page(
    shows: Recording | Sequence[Part],
    *,
    caption: Caption,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> bytes:
    """Return an episode for a page of `format_player`. Arguments as of `format_page`."""
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    data, looks = page_data(parts, speed=speed, shown=shown or Shown())
    style = format_css(looks.custom_colors) if looks.custom_colors else ""
    return to_bytes({**data, **_caption_data(data, caption), "style": style})


def format_player() -> str:
    """Return the page without an episode; it shows the episode that the surrounding page sends."""
    return _fill_template({}, Caption(), Looks(()))


def format_picture_page(recording: "PictureRecording", *, caption: Caption, speed: float = 1.0) -> str:
    """Return the page of an episode of pictures."""
    return _fill_template(picture_data(recording, speed=speed), caption, Looks(()))


def pack_picture_page(recording: "PictureRecording", *, caption: Caption, speed: float = 1.0) -> bytes:
    """Return an episode of pictures for a page of `format_player`."""
    data = picture_data(recording, speed=speed)
    return to_bytes({**data, **_caption_data(data, caption)})


def write_pictures(
    recording: "PictureRecording", path: Path, *, caption: Caption, speed: float = 1.0
) -> None:
    """Write the page of an episode of pictures. Raises OSError."""
    path.write_text(format_picture_page(recording, caption=caption, speed=speed), encoding="utf-8")


def _caption_data(data: dict[str, Any], caption: Caption) -> dict[str, Any]:
    """Return the title and the facts of a page."""
    title = caption.title or next((str(episode["message"]) for episode in data.get("episodes", ())), "")
    return {"title": title or "Episode", "facts": caption.facts}


def _fill_template(data: dict[str, Any], caption: Caption, looks: Looks) -> str:
    """Fill the template of the page with the data for its script."""
    title = _caption_data(data, caption)["title"]
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in caption.facts
    )
    parts = {
        "title": html.escape(title),
        "facts": facts,
        "style": f"{format_css(looks.custom_colors)}\n{_read_part('page.css')}",
        "script": _read_script(),
        # Texts of the simulation must not end the script element.
        "episode": to_json({**TABLES, **data}).replace("<", "\\u003c"),
    }
    # In one pass, so that placeholders in inserted parts are not replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _read_part("page.html"))


@cache
def _read_script() -> str:
    return "\n".join(_read_part(name) for name in SCRIPTS)


@cache
def _read_part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
