"""Output of commands: rich on a terminal, plain lines when piped, one JSON object per line with `--json`.

All output passes through this module, which escapes it (see `swarmwright.common.untrusted`): any part may be
text from a peer or a file. The functions below control the layout: each `text` is one line, further lines of
a message are indented. So foreign text never begins a line at the left margin.
"""

import ctypes
import io
import json
import math
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TextIO, cast

from swarmwright.common import untrusted

if TYPE_CHECKING:
    from rich.console import Console


STDOUT = "standard output"
"""Named in errors."""
_STDOUT = 1
_NARROWEST = 20
"""Columns of a terminal below which lines are not broken between words."""
_PARTS = re.compile("`[^`]*`| +|[^ `]+|`")
"""Text in backticks, spaces, words."""
_COMMAND = re.compile(r" +(\S*/)?(swarmwright |python\S* -m swarmwright )")
"""An indented line that is a command: see `program` in `_evolving`."""
_results: TextIO | None = None
"""The real standard output, while prints of other code go to standard error."""


@contextmanager
def reserve_stdout() -> Iterator[None]:
    """Reserve standard output for the command's own results, which a program reads with `--json`.

    Prints of simulations and modules, in Python or in C, go to standard error.
    """
    global _results
    before = sys.stdout
    if _results is not None or before is None:
        yield
        return
    with _redirect_descriptor(before) as stream:
        _results, sys.stdout = stream, sys.stderr
        try:
            yield
        finally:
            sys.stdout, _results = before, None


@contextmanager
def _redirect_descriptor(stream: TextIO) -> Iterator[TextIO]:
    """Yield a copy of `stream`, while file descriptor 1, which C code writes to, is standard error."""
    try:
        is_standard, error = stream.fileno() == _STDOUT, sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):  # replaced by another program
        is_standard, error = False, -1
    if not is_standard or not isinstance(stream, io.TextIOWrapper):
        yield stream
        return
    stream.flush()
    number = os.dup(_STDOUT)
    os.dup2(error, _STDOUT)
    raw = os.fdopen(number, "wb", 0 if stream.write_through else -1)
    with io.TextIOWrapper(
        raw,
        stream.encoding,
        stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    ) as own:
        try:
            yield own
        finally:
            # C code may have buffered output.
            ctypes.CDLL(None).fflush(None)
            os.dup2(number, _STDOUT)


class _Harmless:
    """A stream for prints of other code, which ignores write errors."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, if possible."""
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write the text, if possible."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Write buffered text, if possible."""
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@contextmanager
def ignore_print_errors() -> Iterator[None]:
    """Ignore errors when code of simulations prints.

    Otherwise a closed pipe (`| head`) or a full disk would fail the simulation and its candidates. Commands
    notice both in their own output.
    """
    global _results  # noqa: PLW0603 - of the process, as the streams are
    before, ours = (sys.stdout, sys.stderr), _results
    # On a terminal, progress bars redirect both.
    if not before[0].isatty():
        _results = _results or before[0]
        sys.stdout = cast("TextIO", _Harmless(before[0]))
    if not before[1].isatty():
        sys.stderr = cast("TextIO", _Harmless(before[1]))
    try:
        yield
    finally:
        (sys.stdout, sys.stderr), _results = before, ours


def get_stdout() -> TextIO:
    """Return standard output."""
    return sys.stdout if _results is None else _results


def replace_nonfinite(value: object) -> object:
    """Replace NaN and infinities, which JSON lacks, by None, at any depth."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): replace_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [replace_nonfinite(item) for item in value]
    return value


@contextmanager
def show_warnings() -> Iterator[None]:
    """Show warnings and slow steps of the library on standard error, a line each, during a `with` block."""
    import logging

    progress = logging.getLogger("swarmwright.progress")

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            complain(record.getMessage())

    progress.setLevel(logging.INFO)
    handler = Handler(logging.INFO)
    handler.addFilter(lambda record: record.levelno >= logging.WARNING or record.name == progress.name)
    logger = logging.getLogger("swarmwright")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def complain(message: str, *, hint: str = "") -> None:
    """Print a message on standard error; its further lines are indented.

    hint: a separate line after it.
    """
    first, *rest = untrusted.escape_lines(message)
    _print([f"swarmwright: {first}", *(f"  {line}" for line in rest), *([hint] if hint else [])], errors=True)


def print_note(line: str, below: Iterable[str] = ()) -> None:
    """Print a line on standard error, and others indented below it."""
    _print([untrusted.escape_line(line), *(f"  {untrusted.escape_line(row)}" for row in below)], errors=True)


def print_document(text: str) -> None:
    """Print a document to standard output; on a terminal, escaped."""
    stream = get_stdout()
    if stream.isatty():
        text = "".join(f"{line}\n" for line in untrusted.escape_lines(text))
    stream.write(text)
    stream.flush()


def wrap_line(line: str, width: int) -> list[str]:
    """Break a line between words into lines of at most `width` columns; all but the first are indented.

    Rows of tables are broken between columns if possible in their right half. Indented commands and text in
    `backticks` are not broken, so that they can be copied. The terminal breaks longer words.
    """
    if len(line) <= width or width < _NARROWEST or _COMMAND.match(line):
        return [line]
    text = line.lstrip(" ")
    indent = " " * (len(line) - len(text))
    rows: list[str] = []
    row: list[tuple[str, str]] = []  # the gap before each word, and the word
    length = 0
    for gap, word in _words(text):
        row.append((gap if row else indent, word))
        length += len(row[-1][0]) + len(word)
        if length > width and len(row) > 1:
            split = _break(row, width)
            rows.append("".join(map("".join, row[:split])))
            row = [(f"{indent}  ", row[split][1]), *row[split + 1 :]]
            length = sum(len(before) + len(cell) for before, cell in row)
    return [*rows, "".join(map("".join, row)).rstrip()]


def _words(text: str) -> Iterator[tuple[str, str]]:
    """Yield the words of a text with the spaces before each; text in backticks belongs to one word."""
    gap, word = "", ""
    for part in _PARTS.findall(text):
        if part[0] != " ":
            word += part
            continue
        yield gap, word
        gap, word = part, ""
    yield gap, word


def _break(row: Sequence[tuple[str, str]], width: int) -> int:
    """Return the index of the word before which to break: at the last column in the right half, if any."""
    position, columns = 0, []
    for number, (gap, word) in enumerate(row):
        if number and len(gap) > 1 and width // 2 < position <= width:
            columns.append(number)
        position += len(gap) + len(word)
    return columns[-1] if columns else len(row) - 1


def _print(lines: Sequence[str], *, errors: bool = False, whole: bool = False) -> None:
    """Print lines, on a terminal broken between words.

    errors: print to standard error. whole: do not break lines, for programs.
    """
    # Looked up each time: a progress bar redirects both.
    stream: TextIO = sys.stderr if errors else get_stdout()
    if not whole and stream.isatty():
        width = shutil.get_terminal_size().columns
        lines = [part for line in lines for part in wrap_line(line, width)]
    try:
        stream.write("".join(f"{line}\n" for line in lines))
        stream.flush()
    except OSError as error:
        error.filename = error.filename or ("standard error" if errors else STDOUT)
        raise


class Output:
    """Standard output of one command.

    as_json: print JSON objects only; `text` then prints nothing.
    """

    def __init__(self, *, as_json: bool = False) -> None:
        self.as_json = as_json
        self.terminal = not as_json and get_stdout().isatty() and os.environ.get("TERM") != "dumb"

    @property
    def color(self) -> bool:
        """Whether to use colours (https://no-color.org)."""
        return self.terminal and not os.environ.get("NO_COLOR")

    @property
    def unicode(self) -> bool:
        """Whether the output can show more than ASCII."""
        return "utf" in (get_stdout().encoding or "").lower()

    def text(self, line: str = "") -> None:
        r"""Print a line for people immediately; a line break is shown as `\n`."""
        if not self.as_json:
            _print([untrusted.escape_line(line)])

    def item(self, text: str, indent: str = "  ") -> None:
        """Print a text, its further lines indented below the first."""
        if not self.as_json:
            first, *rest = untrusted.escape_lines(text)
            _print([first, *(f"{indent}{line}" for line in rest)])

    def block(self, text: str, indent: str = "") -> None:
        """Print a multi-line block, indented.

        indent: if empty, foreign text in the block must have been escaped by `untrusted.escape_line`.
        """
        if not self.as_json:
            _print([f"{indent}{line}".rstrip() for line in untrusted.escape_lines(text)])

    def cells(self, row: Sequence[str]) -> None:
        """Print a table row for other programs, separated by tabs."""
        if not self.as_json:
            _print(["\t".join(map(untrusted.escape_line, row))], whole=True)

    @staticmethod
    def status(text: str) -> None:
        """Overwrite the last line of the terminal, on standard error."""
        sys.stderr.write(f"\r\x1b[K{untrusted.escape_line(text)}")
        sys.stderr.flush()

    @staticmethod
    def has_status() -> bool:
        """Return whether standard error is a terminal, on which a status can be overwritten."""
        return sys.stderr.isatty()

    def json(self, record: Mapping[str, object]) -> None:
        """Print an object for programs immediately."""
        if self.as_json:
            encoded = json.dumps(replace_nonfinite(record), allow_nan=False, ensure_ascii=not self.unicode)
            _print([untrusted.escape_json(encoded)], whole=True)

    def console(self) -> "Console":
        """Return a rich console on standard output; it reads NO_COLOR and the terminal's width itself.

        Its text is escaped, except for line breaks, which tables and wrapped text need.
        """
        from swarmwright.cli._console import EscapingConsole

        return EscapingConsole(highlight=False, emoji=False, markup=False, soft_wrap=not self.terminal)
