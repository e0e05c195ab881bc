"""Output of commands: rich on a terminal, plain lines when piped, one JSON object per line with `--json`.

All output passes through here, and here it is escaped, see `swarmwright.common.untrusted`: any part of it
may be text of a peer or of a file. Layout is what the functions below make of their arguments: each `text`
is one line, further lines of a message are indented. So text of others can never begin a line at the left
margin.
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
"""Standard output, while what other code prints goes to standard error."""


@contextmanager
def only_results() -> Iterator[None]:
    """Within the block, only what a command prints itself is on standard output.

    A program reads it with `--json`; what the code of simulations and modules prints, in Python or in C, goes
    to standard error.
    """
    global _results
    before = sys.stdout
    if _results is not None or before is None:
        yield
        return
    with _own_descriptor(before) as stream:
        _results, sys.stdout = stream, sys.stderr
        try:
            yield
        finally:
            sys.stdout, _results = before, None


@contextmanager
def _own_descriptor(stream: TextIO) -> Iterator[TextIO]:
    """Yield a stream to where `stream` writes, while file descriptor 1, which C code writes to, is stderr."""
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
            # What C code has printed may still be in its buffer.
            ctypes.CDLL(None).fflush(None)
            os.dup2(number, _STDOUT)


class _Harmless:
    """A stream where other code prints: what cannot be written is lost, without an error."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write what can be written."""
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write what can be written."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Write what is kept, if it can be written."""
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@contextmanager
def harmless_printing() -> Iterator[None]:
    """Within the block, code of simulations may print whatever became of the output.

    A reader that has gone (`| head`) or a full disk would be errors of the simulation otherwise, and
    candidates would fail by them. Commands notice both in what they print themselves.
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


def results() -> TextIO:
    """Return standard output."""
    return sys.stdout if _results is None else _results


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
    """Show warnings and slow steps of the library on standard error, a line each."""
    import logging

    progress = logging.getLogger("swarmwright.progress")

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            complain(record.getMessage())

    progress.setLevel(logging.INFO)
    handler = Handler(logging.INFO)
    handler.addFilter(lambda record: record.levelno >= logging.WARNING or record.name == progress.name)
    logging.getLogger("swarmwright").addHandler(handler)


def complain(message: str, *, hint: str = "") -> None:
    """Print a message on standard error; its further lines are indented.

    hint: a separate line after it.
    """
    first, *rest = untrusted.lines(message)
    _print([f"swarmwright: {first}", *(f"  {line}" for line in rest), *([hint] if hint else [])], errors=True)


def aside(line: str, below: Iterable[str] = ()) -> None:
    """Print a line on standard error, and others indented below it."""
    _print([untrusted.one_line(line), *(f"  {untrusted.one_line(row)}" for row in below)], errors=True)


def document(text: str) -> None:
    """Print a document to standard output, as it is where a file or another program takes it."""
    stream = results()
    if stream.isatty():
        text = "".join(f"{line}\n" for line in untrusted.lines(text))
    stream.write(text)
    stream.flush()


def wrapped(line: str, width: int) -> list[str]:
    """Return a line as lines of at most so many columns, broken between words; all but the first indented.

    Rows of tables are broken between columns where that is possible in their right half. Commands are not
    broken, so that they can be copied: a line that is an indented command, and text in `backticks`. What
    has no place for a break is left to the terminal.
    """
    if len(line) <= width or width < _NARROWEST or _COMMAND.match(line):
        return [line]
    text = line.lstrip(" ")
    indent = " " * (len(line) - len(text))
    found: list[str] = []
    row: list[tuple[str, str]] = []  # the gap before each word, and the word
    length = 0
    for gap, word in _words(text):
        row.append((gap if row else indent, word))
        length += len(row[-1][0]) + len(word)
        if length > width and len(row) > 1:
            place = _break(row, width)
            found.append("".join(map("".join, row[:place])))
            row = [(f"{indent}  ", row[place][1]), *row[place + 1 :]]
            length = sum(len(before) + len(cell) for before, cell in row)
    return [*found, "".join(map("".join, row)).rstrip()]


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
    """Return the word before which a row is broken: at the last column in its right half, if there is one."""
    place, columns = 0, []
    for number, (gap, word) in enumerate(row):
        if number and len(gap) > 1 and width // 2 < place <= width:
            columns.append(number)
        place += len(gap) + len(word)
    return columns[-1] if columns else len(row) - 1


def _print(lines: Sequence[str], *, errors: bool = False, whole: bool = False) -> None:
    """Print lines, on a terminal broken between words.

    errors: on standard error. whole: for programs, which get lines unbroken.
    """
    # Looked up each time: while a progress bar is shown, both are redirected above it.
    stream: TextIO = sys.stderr if errors else results()
    if not whole and stream.isatty():
        width = shutil.get_terminal_size().columns
        lines = [part for line in lines for part in wrapped(line, width)]
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
        self.terminal = not as_json and results().isatty() and os.environ.get("TERM") != "dumb"

    @property
    def color(self) -> bool:
        """Whether colours are wanted (https://no-color.org)."""
        return self.terminal and not os.environ.get("NO_COLOR")

    @property
    def unicode(self) -> bool:
        """Whether the output can show more than ASCII."""
        return "utf" in (results().encoding or "").lower()

    def text(self, line: str = "") -> None:
        r"""Print a line for people, at once; a line break in it is shown as `\n`."""
        if not self.as_json:
            _print([untrusted.one_line(line)])

    def item(self, text: str, indent: str = "  ") -> None:
        """Print a text whose further lines, if it has any, are indented below the first."""
        if not self.as_json:
            first, *rest = untrusted.lines(text)
            _print([first, *(f"{indent}{line}" for line in rest)])

    def block(self, text: str, indent: str = "") -> None:
        """Print the lines of a text of several, all of them indented.

        indent: without any, what others wrote must have been escaped in it by `untrusted.one_line`.
        """
        if not self.as_json:
            _print([f"{indent}{line}".rstrip() for line in untrusted.lines(text)])

    def cells(self, row: Sequence[str]) -> None:
        """Print a row of a table for other programs, divided by tabs."""
        if not self.as_json:
            _print(["\t".join(map(untrusted.one_line, row))], whole=True)

    @staticmethod
    def status(text: str) -> None:
        """Write over the last line of the terminal, on standard error."""
        sys.stderr.write(f"\r\x1b[K{untrusted.one_line(text)}")
        sys.stderr.flush()

    @staticmethod
    def has_status() -> bool:
        """Whether standard error is a terminal, on which a status can be written over."""
        return sys.stderr.isatty()

    def json(self, record: Mapping[str, object]) -> None:
        """Print an object for machines, at once."""
        if self.as_json:
            encoded = json.dumps(finite(record), allow_nan=False, ensure_ascii=not self.unicode)
            _print([untrusted.in_json(encoded)], whole=True)

    def console(self) -> "Console":
        """A rich console on standard output; it reads NO_COLOR and the terminal's width itself.

        What is shown on it is escaped, but line breaks, which tables and wrapped text consist of.
        """
        from swarmwright.cli._console import EscapingConsole

        return EscapingConsole(highlight=False, emoji=False, markup=False, soft_wrap=not self.terminal)
