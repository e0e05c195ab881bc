"""A rich console that escapes text of peers and files."""

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress_bar import ProgressBar
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from swarmwright.common import untrusted

if TYPE_CHECKING:
    from swarmwright.cli._output import Output


class EscapingConsole(Console):
    """A console that escapes all rendered text, except for rich's control codes."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(_escape(segment.text), segment.style)


def _escape(text: str) -> str:
    return "\n".join(map(untrusted.escape_line, text.split("\n")))


def text(words: str, style: str = "") -> Text:
    """Return one line of text, escaped."""
    return Text(untrusted.escape_line(words), style)


def waiting(words: str) -> Text:
    """Return a line that says what the program waits for, cut to the width of the terminal."""
    line = text(words, "yellow")
    line.no_wrap, line.overflow = True, "ellipsis"
    return line


def bar(share: float) -> ProgressBar:
    """Return a bar, filled to a share from 0 to 1."""
    return ProgressBar(
        total=1.0, completed=share, style="bright_black", complete_style="cyan", finished_style="green"
    )


def table(
    output: "Output", headings: Sequence[str], rows: Iterable[Sequence[str | Text]], right: Collection[str]
) -> Table:
    """Return a table of single-line cells. right: headings of the columns that are aligned to the right."""
    result = Table(box=box.SIMPLE_HEAD if output.unicode else box.ASCII, pad_edge=False)
    for heading in headings:
        result.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    for row in rows:
        result.add_row(*(text(cell) if isinstance(cell, str) else cell for cell in row))
    return result
