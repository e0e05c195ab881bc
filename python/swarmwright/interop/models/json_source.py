"""JSON files with the lines of their values."""

import math
import re
from json.decoder import scanstring  # type: ignore[attr-defined]
from pathlib import Path
from typing import Any, NoReturn

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.common.yaml import LARGEST_FILE, LONGEST_NUMBER, Path_, Source

_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")
_BLANK = re.compile(r"[ \t\r\n]*")
_WORDS = {"null": None, "true": True, "false": False}
_NOT_FINITE = re.compile(r"[+-]?(?:NaN|Infinity|inf|nan)")
_DEEPEST_NESTING = 100
"""Deepest nesting."""


def read(path: Path) -> Source:
    """Read a JSON file.

    Raises InputError, with file and line, when it cannot be read or is not valid JSON; duplicate keys are
    collected in `problems`.
    """
    try:
        data = read_bytes(path, LARGEST_FILE)
    except FileNotFoundError:
        raise InputError(f"{path}: file not found") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return parse(data.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}:{line}: is not UTF-8 text") from error


def parse(text: str, name: str) -> Source:
    """Parse JSON text; `name` is used in messages. Raises InputError as `read` does."""
    reader = _Reader(text, name)
    reader.source.values = reader.value((), 0)
    if reader.at < len(text):
        reader.fail("unexpected text after the end of the value")
    return reader.source


class _Reader:
    def __init__(self, text: str, name: str) -> None:
        self.text = text
        self.source = Source(name)
        self.at = 0
        self._line, self._counted = 1, 0
        self._skip()

    def fail(self, message: str) -> NoReturn:
        raise InputError(f"{self.source.name}:{self.line}: is not valid JSON: {message}")

    @property
    def line(self) -> int:
        """The current line, from 1."""
        self._line += self.text.count("\n", self._counted, self.at)
        self._counted = self.at
        return self._line

    def _skip(self) -> None:
        blank = _BLANK.match(self.text, self.at)
        self.at = self.at if blank is None else blank.end()

    def _skip_sign(self, sign: str) -> bool:
        if not self.text.startswith(sign, self.at):
            return False
        self.at += len(sign)
        self._skip()
        return True

    def value(self, path: Path_, depth: int) -> Any:  # noqa: ANN401 - any JSON value
        if depth > _DEEPEST_NESTING:
            self.fail(f"nesting is deeper than {_DEEPEST_NESTING} levels")
        self.source.lines.setdefault(path, self.line)
        if self._skip_sign("{"):
            return self._object(path, depth)
        if self._skip_sign("["):
            return self._array(path, depth)
        if self.text.startswith('"', self.at):
            return self._string()
        for word, value in _WORDS.items():
            if self._skip_sign(word):
                return value
        return self._number()

    def _number(self) -> int | float:
        match = _NUMBER.match(self.text, self.at)
        if match is None:
            wrong = _NOT_FINITE.match(self.text, self.at)
            if wrong is not None:
                self.fail(f"{wrong[0]} is not a JSON number")
            rest = self.text[self.at : self.at + 20].split("\n")[0]
            self.fail(f"{rest!r} found, expected a value" if rest else "the text ends too early")
        self.at = match.end()
        if match[1] is None and match[2] is None:
            if len(match[0]) > LONGEST_NUMBER:
                self.fail("the number is too long")
            number: int | float = int(match[0])
        else:
            number = float(match[0])
            if not math.isfinite(number):
                self.fail(f"{match[0]} is too large for a number")
        self._skip()
        return number

    def _string(self) -> str:
        try:
            text, self.at = scanstring(self.text, self.at + 1, True)
        except ValueError as error:
            self.fail(str(error).split(":")[0])
        self._skip()
        return str(text)

    def _object(self, path: Path_, depth: int) -> dict[str, Any]:
        members: dict[str, Any] = {}
        if self._skip_sign("}"):
            return members
        while True:
            if not self.text.startswith('"', self.at):
                self.fail("expected a key in quotation marks")
            line = self.line
            key = self._string()
            inner = (*path, key)
            if not self._skip_sign(":"):
                self.fail(f"expected ':' after the key {key!r}")
            if key in members:
                first = self.source.lines[inner]
                self.source.problems.append(
                    (inner, line, f"duplicate key in one object (first in line {first})")
                )
                self.value((*inner, "duplicate"), depth + 1)
            else:
                self.source.lines[inner] = line
                members[key] = self.value(inner, depth + 1)
            if self._skip_sign("}"):
                return members
            if not self._skip_sign(","):
                self.fail("expected ',' or '}'")

    def _array(self, path: Path_, depth: int) -> list[Any]:
        items: list[Any] = []
        if self._skip_sign("]"):
            return items
        while True:
            items.append(self.value((*path, len(items)), depth + 1))
            if self._skip_sign("]"):
                return items
            if not self._skip_sign(","):
                self.fail("expected ',' or ']'")
