"""A rich console that escapes text of peers and files."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from swarmwright.common import untrusted

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text


class EscapingConsole(Console):
    """A console that escapes all rendered text, except for rich's control codes."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(_escape(segment.text), segment.style)


def _escape(text: str) -> str:
    return "\n".join(map(untrusted.escape_line, text.split("\n")))


def text(words: str, style: str = "") -> "Text":
    """Return one line of text, escaped."""
    from rich.text import Text

    return Text(untrusted.escape_line(words), style)


def add_row(table: "Table", cells: Sequence["str | Text"]) -> None:
    """Add a row of single-line cells to a table."""
    table.add_row(*(text(cell) if isinstance(cell, str) else cell for cell in cells))
