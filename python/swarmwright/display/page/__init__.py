"""Episodes as a self-contained HTML page: play, step, scrub, zoom, follow an agent; works offline."""

import html
import json
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.display._episode import Caption, Part, Recording, Shown
from swarmwright.display._look import Looks, format_css
from swarmwright.display.page._data import page_data, picture_data

if TYPE_CHECKING:
    from swarmwright.display.pictures import PictureRecording

SCRIPTS = (
    "shapes.js", "series.js", "camera.js", "ground.js", "signals.js", "sprites.js", "world.js", "pictures.js",
    "curve.js", "legend.js", "machine.js", "tree.js", "inspector.js", "player.js",
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


def write_pictures(
    recording: "PictureRecording", path: Path, *, caption: Caption, speed: float = 1.0
) -> None:
    """Write the page of an episode of pictures. Raises OSError."""
    path.write_text(
        _fill_template(picture_data(recording, speed=speed), caption, Looks(())), encoding="utf-8"
    )


def _fill_template(data: dict[str, Any], caption: Caption, looks: Looks) -> str:
    """Fill the template of the page with the data for its script."""
    title = caption.title or str(data["episodes"][0]["message"]) or "Episode"
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in caption.facts
    )
    # Texts of the simulation must not end the script element.
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace(
        "<", "\\u003c"
    )
    parts = {
        "title": html.escape(title),
        "facts": facts,
        "style": f"{format_css(looks.custom_colors)}\n{_read_part('page.css')}",
        "script": "\n".join(_read_part(name) for name in SCRIPTS),
        "episode": text,
    }
    # In one pass, so that placeholders in inserted parts are not replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _read_part("page.html"))


def _read_part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
