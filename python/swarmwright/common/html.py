"""What notebooks show of objects: small tables and pictures, every text escaped."""

import base64
import html
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from swarmwright.common.plain_figures import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CELL = "text-align: left; vertical-align: top; padding: 0.15em 0.8em 0.15em 0"


def facts(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """Return a table of names and values under a title; of no rows, the title alone."""
    lines = [
        f'<tr><th style="{_CELL}">{html.escape(name)}</th>'
        f'<td style="{_CELL}">{html.escape(str(value))}</td></tr>'
        for name, value in rows
    ]
    below = f"<table>{''.join(lines)}</table>" if lines else ""
    return f"<div><strong>{html.escape(title)}</strong>{below}</div>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a line of headings."""
    top = "".join(f'<th style="{_CELL}">{html.escape(name)}</th>' for name in head)
    lines = [
        "<tr>" + "".join(f'<td style="{_CELL}">{html.escape(str(cell))}</td>' for cell in row) + "</tr>"
        for row in rows
    ]
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def preformatted(text: str) -> str:
    """Return a text of several lines as it is printed."""
    return f"<pre>{html.escape(text)}</pre>"


def picture(png: bytes, width: int, words: str) -> str:
    """Return a picture that is part of the page; words: for those who cannot see it."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img width="{width}" alt="{html.escape(words)}" src="data:image/png;base64,{data}">'


@plain()
def png_of(figure: "Figure") -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
