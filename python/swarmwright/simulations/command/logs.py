"""Reading the logs of a command: columns of numbers from tables, JSON and messages."""

import csv
import io
import json
import math
import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from swarmwright.common.formatting import format_count
from swarmwright.common.suggestions import did_you_mean
from swarmwright.simulations.command import bags
from swarmwright.simulations.command.definition import STANDARD_OUTPUT
from swarmwright.simulations.command.process import CommandFailure

_PREFIX = "(?:da|[YZEPTGMkhdcm\u00b5\u03bcunpfazy])?"
_UNIT = (
    r"(?:%|\u00b0[CF]?|deg(?:rees?)?|rad(?:ians?)?|rpm|px|pixels?|steps?|ticks?|min|h|d|hours?|days?|sec|secs|seconds?"
    r"|met(?:er|re)s?|count|bool|"
    + _PREFIX
    + r"(?:mol|cd|rad|sr|Hz|Pa|Wh|Ah|eV|bar|bit|byte|bps|lx|lm|dB|dBm|ohm"
    r"|[smgAKNJWVCFHTLB\u03a9]))(?:\^?-?\d|[\u00b2\u00b3])?"
)
_PRODUCT = rf"(?:1/)?{_UNIT}(?:[ */.\u00b7]{_UNIT})*"
_CELL = re.compile(rf"\s*(?:[-\u2013]?|{_PRODUCT}|\[[^\[\]\d]*(?:{_PRODUCT})?\]|\((?:-|{_PRODUCT})\))\s*")

_NUMBER = re.compile(r"\s*[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf)\s*", re.IGNORECASE)


def is_unit_row(values: Sequence[str], following: Sequence[str]) -> bool:
    """Return whether a row has units, such as m/s, [rad] or %, and the next one numbers."""
    return (
        any(value.strip(" -\u2013") for value in values)
        and all(map(_CELL.fullmatch, values))
        and any(map(_NUMBER.fullmatch, following))
    )


class Problem(NamedTuple):
    """The reason why a value cannot be used."""

    text: str
    is_number: bool
    """Whether the value is a number: NaN or infinite."""


class Column(list[float]):
    """The values of a column, in the order of the rows; NaN if they are not numbers."""

    def __init__(self) -> None:
        super().__init__()
        self._first: Problem | None = None
        self._last: Problem | None = None
        self._strange: Problem | None = None
        """The first value that is not a number."""
        self._infinite: Problem | None = None
        """The first number that is not finite."""

    def add(self, location: str, name: str, value: Any) -> None:  # noqa: ANN401 - whatever the log holds
        """Add the value of a row."""
        number, self._last = _parse_number(location, name, value)
        if not self:
            self._first = self._last
        if self._last is not None and self._last.is_number:
            self._infinite = self._infinite or self._last
        else:
            self._strange = self._strange or self._last
        self.append(number)

    def problem(self, function: str) -> Problem | None:
        """Return the problem with the values that a reduction uses; None if there is none."""
        if function == "count":
            return None
        if function in {"first", "last"}:
            return self._first if function == "first" else self._last
        return self._strange or self._infinite


Columns = dict[str, Column]
Row = tuple[str, Mapping[str, Any]]
"""The location of a row, `log.csv:3`, and its values by column."""

_FORMATS = {
    ".csv": "csv",
    ".tsv": "tsv",
    ".tab": "tsv",
    ".jsonl": "jsonl",
    ".ndjson": "jsonl",
    ".json": "json",
    ".bag": "rosbag",
    ".db3": "rosbag",
    ".mcap": "mcap",
}
Reader = Callable[[str, Path | bytes, Collection[str]], Iterator[Row]]
"""Called with a log's name, its path or content, and the names of the required columns."""
_SHOWN_NAMES = 12
"""Largest number of names of columns in a message."""
_SHOWN_CHARACTERS = 60
"""Largest number of characters of a line in a message."""
_PLAIN = re.compile(r"[0-9A-Za-z.+-]+")
"""A number, NaN or infinity, or another word."""
_KINDS = {stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
_WORDS = {"true": 1.0, "false": 0.0}


def choose_format(path: str, declared: str) -> str:
    """Return the declared format of a log, or for `auto` the format by its suffix, by default csv."""
    return declared if declared != "auto" else _FORMATS.get(Path(path).suffix.lower(), "csv")


def find(folder: Path, logs: Sequence[str]) -> list[Path]:
    """Return the files, or folders for some formats, of the logs; those of a pattern are sorted by name.

    Raises CommandFailure if a log is missing, and for named pipes and devices, whose reading may never end.
    """
    files: list[Path] = []
    for log in logs:
        matches = [folder / log] if not set("*?[") & set(log) else sorted(folder.glob(log))
        matches = [file for file in matches if file.exists()]
        if not matches:
            raise CommandFailure(f"ended without writing {log} (simulation.log); {_list_folder(folder)}")
        for file in matches:
            _require_regular(file, folder)
        files += matches
    return files


def _require_regular(file: Path, folder: Path) -> None:
    """Raise CommandFailure unless a path, and everything in a folder, is a regular file or a folder."""
    for path in (file, *file.rglob("*")) if file.is_dir() else (file,):
        with suppress(OSError):  # a broken link, which is reported when it is read
            kind = stat.S_IFMT(path.stat().st_mode)
            if kind not in {stat.S_IFREG, stat.S_IFDIR}:
                name = path.relative_to(folder).as_posix()
                raise CommandFailure(f"{name}: is {_KINDS.get(kind, 'a device')}, expected a file")


def read(files: Mapping[str, Path | bytes], formats: str, required: Collection[str]) -> Columns:
    """Return the required columns, with the rows of all files concatenated.

    Args:
        files: path or content, by name for messages.
        formats: `auto`, or the format of all files.
        required: names of columns.

    Raises CommandFailure for a file that is cut off or cannot be read, and for a missing column.
    """
    columns: Columns = {name: Column() for name in required}
    names: dict[str, None] = {}
    for name, file in files.items():
        form = choose_format(name, formats)
        if name == STANDARD_OUTPUT and isinstance(file, bytes):
            form, file = _strip_banner(file, form, formats == "auto", required)  # noqa: PLW2901 - the rest
        reader = _READERS[form]
        for location, row in reader(name, file, required):
            for column in row:
                names.setdefault(column)
            for column in required:
                if column in row:
                    columns[column].add(location, column, row[column])
    if not names:
        raise CommandFailure(f"{', '.join(files)}: has no rows")
    for column, values in columns.items():
        if not values:
            available = ", ".join(list(names)[:_SHOWN_NAMES]) + (", .." if len(names) > _SHOWN_NAMES else "")
            where, hint = ", ".join(files), did_you_mean(column, list(names))
            raise CommandFailure(f"{where}: has no column {column!r}{hint or ';'} available: {available}")
    return columns


def _strip_banner(data: bytes, form: str, is_guessed: bool, columns: Collection[str]) -> tuple[str, bytes]:
    """Return the format of a command's output, and the log in it.

    Libraries may print a banner or warnings into the output. Such lines are replaced by empty ones, so that
    line numbers stay correct: in JSON, lines that do not begin an object; in a table, lines before the
    header.
    """
    lines = data.split(b"\n")
    starts = [line.lstrip()[:1] for line in lines]
    if is_guessed and next((beginning for beginning in reversed(starts) if beginning), b"") == b"{":
        form = "jsonl"
    if form == "jsonl":
        lines = [line if start == b"{" else b"" for line, start in zip(lines, starts, strict=True)]
    elif form == "json":
        first = next((at for at, start in enumerate(starts) if start in {b"{", b"["}), 0)
        lines[:first] = [b""] * first
    elif form in {"csv", "tsv"}:
        delimiter = "\t" if form == "tsv" else ","
        texts = [line.decode("utf-8-sig", "replace").rstrip("\r") for line in lines]
        first = next(
            (
                at
                for at, text in enumerate(texts)
                if _can_be_read(text, delimiter) and not set(columns).isdisjoint(_words(text, delimiter))
            ),
            0,
        )
        lines[:first] = [
            line if start == b"#" else b"" for line, start in zip(lines[:first], starts, strict=False)
        ]
    return form, b"\n".join(lines)


def _parse_number(location: str, column: str, value: Any) -> tuple[float, Problem | None]:  # noqa: ANN401 - as above
    """Return a value as a number, or NaN, and its problem, if any."""
    try:
        number = _WORDS.get(value.strip().lower(), math.nan) if isinstance(value, str) else float(value)
        if isinstance(value, str) and math.isnan(number):
            if not _PLAIN.fullmatch(value.strip()):  # float() accepts 1_000 and the digits of all scripts
                raise ValueError
            number = float(value)
    except (TypeError, ValueError, OverflowError):
        shown = repr(value) if len(repr(value)) < 40 else f"{repr(value)[:37]}..."
        return math.nan, Problem(f"{location}: {column} is {shown}, expected a number", is_number=False)
    if not math.isfinite(number):
        return number, Problem(f"{location}: {column} is {number}, expected a finite number", is_number=True)
    return number, None


def _read_text(name: str, file: Path | bytes) -> str:
    try:
        data = file if isinstance(file, bytes) else file.read_bytes()
        return data.decode("utf-8-sig")
    except OSError as error:
        raise CommandFailure(f"{name}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError:
        raise CommandFailure(f"{name}: is not UTF-8 text") from None


def _table(delimiter: str) -> Reader:
    def rows(name: str, file: Path | bytes, columns: Collection[str]) -> Iterator[Row]:
        names, before, text = _find_header(name, _read_text(name, file), delimiter, columns)
        source = _Lines(text, before)
        lines = csv.reader(source, delimiter=_sign(names or text, delimiter))
        header = None if names is None else _check_unique(name, _words(names, delimiter), columns)
        row: tuple[str, list[str]] | None = None
        count = 0
        try:
            for line in lines:
                source.is_between = True
                if not line or (len(line) == 1 and not line[0].strip()):
                    continue
                location = f"{name}:{source.number}"
                if header is None:
                    names = ",".join(line)
                    header = _check_unique(name, [_word(word) for word in line], columns)
                    continue
                if len(line) != len(header):
                    raise CommandFailure(
                        f"{location}: has {format_count(len(line), 'value')}, expected "
                        f"{format_count(len(header), 'column')}; "
                        + ("was the log cut off?" if len(line) < len(header) else _quote_header(names or ""))
                    )
                if row is not None and not (count == 1 and is_unit_row(row[1], line)):
                    yield row[0], dict(zip(header, row[1], strict=True))
                row, count = (location, line), count + 1
            if row is not None and header is not None:
                yield row[0], dict(zip(header, row[1], strict=True))
        except csv.Error as error:
            raise _no_table(f"{name}:{source.number}", error) from None

    return rows


class _Lines:
    """The lines of a table without comments: lines that begin with # outside quotes.

    Args:
        text: the table.
        number: number of the last line before it.
    """

    def __init__(self, text: str, number: int) -> None:
        self._lines = iter(io.StringIO(text))
        self.number = number
        """Number of the last line that was read, from 1."""
        self.is_between = True
        """Whether the next line begins a row, rather than continuing a value in quotes."""

    def __iter__(self) -> Iterator[str]:
        for line in self._lines:
            self.number += 1
            if self.is_between and line.lstrip().startswith("#"):
                continue
            self.is_between = False
            yield line


def _no_table(location: str, error: csv.Error) -> CommandFailure:
    if "new-line" in str(error):  # Python's message addresses the program that opens the file
        return CommandFailure(
            f"{location}: has a carriage return without a line feed; end lines with \\n or \\r\\n"
        )
    return CommandFailure(f"{location}: is not a table: {error}")


def _check_unique(name: str, header: list[str], columns: Collection[str]) -> list[str]:
    """Return the names of columns. Raises CommandFailure for a duplicate among the required ones."""
    for column in columns:
        if header.count(column) > 1:
            raise CommandFailure(f"{name}: has several columns {column!r}; give each a different name")
    return header


def _quote_header(names: str) -> str:
    return f"their names were read from this line: {names.strip()[:_SHOWN_CHARACTERS]!r}"


def _find_header(
    name: str, text: str, delimiter: str, columns: Collection[str]
) -> tuple[str | None, int, str]:
    """Find the names of the columns, which may follow, or be the last of, comments: lines that begin with #.

    Returns the comment with the names, or None; the number of lines before the remaining text; and the
    remaining text, which begins with the names if they are not a comment. Raises CommandFailure if the line
    with the names is not a line of a table.
    """
    comments: list[str] = []
    number = start = 0
    line = ""
    while start < len(text):
        end = text.find("\n", start)
        line = text[start : end if end >= 0 else len(text)]
        if line.strip() and not line.lstrip().startswith("#"):
            break
        comments += [line] if line.strip() else []
        number, start, line = number + 1, end + 1 if end >= 0 else len(text), ""
    rest = text[start:]
    try:
        words = _words(line, delimiter)
    except csv.Error as error:
        raise _no_table(f"{name}:{number + 1}", error) from None
    # Comments that are not valid lines of a table, such as with a carriage return in them, have no names.
    comments = [comment for comment in comments if _can_be_read(comment, delimiter)]
    if not comments or not set(columns).isdisjoint(words):
        return None, number, rest
    for comment in reversed(comments):
        if not set(columns).isdisjoint(_words(comment, delimiter)):
            return comment, number, rest
    # No comment has a required name, which is reported with the available names.
    return (comments[-1] if not words or any(map(_is_number, words)) else None), number, rest


def _sign(line: str, delimiter: str) -> str:
    """Return the character between values, a semicolon in a line without commas."""
    first = line.partition("\n")[0]
    return ";" if delimiter == "," and ";" in first and "," not in first else delimiter


def _words(line: str, delimiter: str) -> list[str]:
    return [_word(word) for words in csv.reader([line], delimiter=_sign(line, delimiter)) for word in words]


def _can_be_read(line: str, delimiter: str) -> bool:
    with suppress(csv.Error):
        _words(line, delimiter)
        return True
    return False


def _word(word: str) -> str:
    return word.strip().removeprefix("#").strip()


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _agent(name: str, file: Path | bytes, _columns: Collection[str]) -> Iterator[Row]:
    """Yield a single row for an agent's log: its number of steps, and the first and last of its values.

    The format is that of the fitness functions of Modelio's CPSwarm module: the last value is that of the
    largest step.
    """
    values: dict[int, float] = {}
    for number, line in enumerate(_read_text(name, file).splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split("\t")
        location = f"{name}:{number}"
        if len(words) != 2 or not re.fullmatch(r"\s*[+-]?\d{1,18}\s*", words[0]):
            raise CommandFailure(
                f"{location}: {line[:40]!r} found, expected a whole number, a tab and a number"
            )
        values[int(words[0])], problem = _parse_number(location, "value", words[1])
        if problem is not None and not problem.is_number:
            raise CommandFailure(problem.text)
    series = [values[step] for step in sorted(values)]
    yield name, {"steps": len(series), **({} if not series else {"first": series[0], "last": series[-1]})}


def _json_lines(name: str, file: Path | bytes, _columns: Collection[str]) -> Iterator[Row]:
    # Strings in JSON may contain other line separators, such as U+2028.
    for number, line in enumerate(_read_text(name, file).split("\n"), 1):
        if line.strip():
            yield (
                f"{name}:{number}",
                _flatten_object(f"{name}:{number}", _parse_json(f"{name}:{number}", line)),
            )


def _json(name: str, file: Path | bytes, _columns: Collection[str]) -> Iterator[Row]:
    value = _parse_json(name, _read_text(name, file))
    for index, element in enumerate(value if isinstance(value, list) else [value]):
        location = f"{name}: item {index}" if isinstance(value, list) else name
        yield location, _flatten_object(location, element)


def _parse_json(location: str, text: str) -> Any:  # noqa: ANN401 - any JSON value
    try:
        return json.loads(text)
    except ValueError as error:
        raise CommandFailure(f"{location}: is not valid JSON: {error}; was the log cut off?") from None
    except RecursionError:
        raise CommandFailure(f"{location}: is nested too deeply") from None


def _flatten_object(location: str, value: Any) -> dict[str, Any]:  # noqa: ANN401 - any JSON value
    if not isinstance(value, dict):
        raise CommandFailure(f"{location}: is not a JSON object, {{..}}")
    try:
        return dict(flat(value))
    except RecursionError:
        raise CommandFailure(f"{location}: is nested too deeply") from None


def flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings, with names such as `pose.x`."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _list_folder(folder: Path) -> str:
    """Return a description of the files in a work folder, for a message."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    if not names:
        return "its work folder is empty; have the command write to {folder}, its working folder"
    more = f" and {len(names) - _SHOWN_NAMES} more" if len(names) > _SHOWN_NAMES else ""
    return f"its work folder contains: {', '.join(names[:_SHOWN_NAMES])}{more}"


_READERS: dict[str, Reader] = {
    "csv": _table(","),
    "tsv": _table("\t"),
    "agents": _agent,
    "jsonl": _json_lines,
    "json": _json,
    "rosbag": bags.read_rosbag,
    "mcap": bags.read_mcap,
}
