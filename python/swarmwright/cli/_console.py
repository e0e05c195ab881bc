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
    """Escapes every text that is rendered; control codes of rich come as such and are not changed."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(_escaped(segment.text), segment.style)


def _escaped(text: str) -> str:
    return "\n".join(map(untrusted.one_line, text.split("\n")))


def text(words: str, style: str = "") -> "Text":
    """Return one line of text, escaped."""
    from rich.text import Text

    return Text(untrusted.one_line(words), style)


def add_row(table: "Table", cells: Sequence["str | Text"]) -> None:
    """Add a row to a table, each cell of it one line."""
    table.add_row(*(text(cell) if isinstance(cell, str) else cell for cell in cells))
