"""SysML v2's textual notation as statements: words up to `;`, or up to a body in braces."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.files import read_bytes

_LARGEST_FILE_BYTES = 1 << 24
_DEEPEST_NESTING = 50
"""Levels of nesting."""
_WITH_COMMENT = frozenset({"comment", "doc", "rep"})
"""Words of statements that end with a comment."""
_TOKEN = re.compile(
    r"(?P<blank>[ \t\r\n\f]+|//[^\n]*)"
    r"|(?P<comment>/\*.*?\*/)"
    r"|(?P<name>[^\W\d]\w*|'(?:[^'\\\n]|\\.)*')"
    r"|(?P<number>(?:\d+\.(?!\.)\d*|\d+|\.\d+)(?:[eE][+-]?\d+)?)"
    r'|(?P<text>"(?:[^"\\\n]|\\.)*")'
    r"|(?P<sign>:>>|::>|:>|::|:=|\.\.|[{}\[\]();:,=~@#*.+\-/<>&|!?%^$])",
    re.DOTALL,
)


@dataclass(frozen=True)
class Token:
    """A word, number, text or sign, and where it stands: line, and characters of the file."""

    kind: str
    text: str
    line: int
    begin: int
    end: int

    @property
    def name(self) -> str:
        """A name without its quotation marks."""
        return self.text[1:-1] if self.text.startswith("'") else self.text


@dataclass
class Statement:
    """Tokens, and the statements in the braces behind them; None where a semicolon ends it."""

    tokens: list[Token]
    line: int
    end: int
    """Where the semicolon or the brace is, in characters."""
    body: list["Statement"] | None = field(default=None)


def read_text(path: Path) -> str:
    """Return a file's text. Raises InputError when it cannot be read or is not UTF-8."""
    try:
        return read_bytes(path, _LARGEST_FILE_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text (byte {error.start} is not part of a character)"
        ) from error


def statements(text: str, path: Path) -> list[Statement]:
    """Return the statements of a text. Raises InputError where it is not this notation, file and line."""
    tokens = list(_tokens(text, path))
    found, at = _block(tokens, 0, path, 0)
    if at < len(tokens):
        raise InputError(f"{path}:{tokens[at].line}: '}}' found without the '{{' that it closes")
    return found


def _tokens(text: str, path: Path) -> Iterator[Token]:
    at, line = 0, 1
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None or (match[0] == "/" and text.startswith("/*", at)):
            what = "a comment is not closed" if text.startswith("/*", at) else f"{text[at]!r} is not expected"
            raise InputError(f"{path}:{line}: is not valid SysML: {what}")
        if match.lastgroup != "blank":
            yield Token(str(match.lastgroup), match[0], line, at, match.end())
        line += match[0].count("\n")
        at = match.end()


def _block(tokens: list[Token], at: int, path: Path, depth: int) -> tuple[list[Statement], int]:
    """Return the statements up to the closing brace or the end, and where that is."""
    found: list[Statement] = []
    words: list[Token] = []
    while at < len(tokens) and tokens[at].text != "}":
        token = tokens[at]
        at += 1
        if token.text == ";":
            if words:
                found.append(Statement(words, words[0].line, token.begin))
            words = []
        elif token.kind == "comment":
            if words and words[0].text in _WITH_COMMENT:
                found.append(Statement(words, words[0].line, token.end))
                words = []
        elif token.text == "{":
            if depth >= _DEEPEST_NESTING:
                raise InputError(f"{path}:{token.line}: nested more than {_DEEPEST_NESTING} deep")
            body, at = _block(tokens, at, path, depth + 1)
            if at >= len(tokens):
                raise InputError(f"{path}:{token.line}: is not valid SysML: '{{' is not closed")
            at += 1
            found.append(Statement(words, words[0].line if words else token.line, token.begin, body))
            words = []
        else:
            words.append(token)
    if words:
        last = words[-1]
        raise InputError(f"{path}:{last.line}: is not valid SysML: ';' is missing after {last.text!r}")
    return found, at
