"""What commands print: rich on a terminal, plain lines when piped, one JSON object a line with `--json`."""

import json
import math
import os
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def finite(value: object) -> object:
    """The value as JSON can carry it: NaN and infinities become null, in any depth."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


def show_warnings() -> None:
    """Show what the library warns of, and what takes it long, on standard error, a line each."""
    import logging

    course = logging.getLogger("swarmwright.course")

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            # Looked up each time: while a progress bar is shown, standard error is redirected above it.
            print(f"swarmwright: {record.getMessage()}", file=sys.stderr, flush=True)

    course.setLevel(logging.INFO)
    handler = Handler(logging.INFO)
    handler.addFilter(lambda record: record.levelno >= logging.WARNING or record.name == course.name)
    logging.getLogger("swarmwright").addHandler(handler)


class Output:
    """Standard output of one command.

    as_json: print JSON objects only; `text` then prints nothing.
    """

    def __init__(self, *, as_json: bool = False) -> None:
        self.as_json = as_json
        self.terminal = not as_json and sys.stdout.isatty() and os.environ.get("TERM") != "dumb"

    @property
    def color(self) -> bool:
        """Whether colours are wanted (https://no-color.org)."""
        return self.terminal and not os.environ.get("NO_COLOR")

    @property
    def unicode(self) -> bool:
        """Whether the output can show more than ASCII."""
        return "utf" in (sys.stdout.encoding or "").lower()

    def text(self, line: str = "") -> None:
        """Print a line for people, at once."""
        if not self.as_json:
            print(line, flush=True)

    def json(self, record: Mapping[str, object]) -> None:
        """Print an object for machines, at once."""
        if self.as_json:
            print(json.dumps(finite(record), allow_nan=False, ensure_ascii=not self.unicode), flush=True)

    def console(self) -> "Console":
        """A rich console on standard output; it reads NO_COLOR and the terminal's width itself."""
        from rich.console import Console

        return Console(highlight=False, emoji=False, markup=False, soft_wrap=not self.terminal)
