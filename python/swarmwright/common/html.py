"""HTML of objects in notebooks: small tables and pictures, with all text escaped."""

import base64
import html
import io
import sys
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from swarmwright.common.plain_figures import use_plain_settings
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_CELL = "text-align: left; vertical-align: top; padding: 0.15em 0.8em 0.15em 0"


def facts(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """Return a table of names and values under a title; without rows, only the title."""
    lines = [
        f'<tr><th style="{_CELL}">{html.escape(name)}</th>'
        f'<td style="{_CELL}">{html.escape(str(value))}</td></tr>'
        for name, value in rows
    ]
    below = f"<table>{''.join(lines)}</table>" if lines else ""
    return f"<div><strong>{html.escape(title)}</strong>{below}</div>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a row of headings."""
    top = "".join(f'<th style="{_CELL}">{html.escape(name)}</th>' for name in head)
    lines = [
        "<tr>" + "".join(f'<td style="{_CELL}">{html.escape(str(cell))}</td>' for cell in row) + "</tr>"
        for row in rows
    ]
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def render_preformatted(text: str) -> str:
    """Return a multi-line text in its printed form."""
    return f"<pre>{html.escape(text)}</pre>"


def picture(png: bytes, width: int, words: str) -> str:
    """Return an embedded picture; words: its alternative text."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img width="{width}" alt="{html.escape(words)}" src="data:image/png;base64,{data}">'


@use_plain_settings()
def png_of(figure: "Figure") -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


INTERVAL_S = 0.25
"""Seconds between two changes of a text."""


def is_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    if ipython is None or "ipykernel" not in sys.modules:
        return False
    return hasattr(ipython.get_ipython(), "kernel")


class Text:
    """A replaceable text: below the cell in a notebook, otherwise a line on standard error."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._notebook = is_notebook()
        self._shown = 0.0
        self._width = 0

    def show(self, text: str, *, at_once: bool = False) -> None:
        """Replace the text, at most every INTERVAL_S unless `at_once`."""
        now = time.monotonic()
        if not at_once and now - self._shown < INTERVAL_S:
            return
        self._shown = now
        text = escape_line(text)
        if not self._notebook:
            sys.stderr.write("\r" + text.ljust(self._width))
            sys.stderr.flush()
            self._width = len(text)
            return
        content = {"text/plain": text}
        if self._handle is None:
            from IPython.display import display  # noqa: PLC0415 - only in notebooks

            self._handle = display(  # type: ignore[no-untyped-call]
                content, raw=True, display_id=True
            )
        else:
            self._handle.update(content, raw=True)

    def close(self) -> None:
        """End the line on standard error."""
        if not self._notebook and self._width:
            sys.stderr.write("\n")
