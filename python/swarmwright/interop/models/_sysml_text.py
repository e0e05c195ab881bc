"""SysML v2's and KerML's textual notation as statements: words up to `;`, or up to a body in braces.

The grammar follows the standard's lexical structure and nesting (KerML 1.0, 8.2.2; SysML 2.0, 8.2.2.1).
Modules that use it interpret the words of the statements.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lark import Lark, Token, Transformer, UnexpectedCharacters, UnexpectedToken
from lark.lark import PostLex

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes

KERML = ".kerml"
"""Suffix of files in KerML, which has other reserved words."""
_LARGEST_FILE_BYTES = 1 << 24
_DEEPEST_NESTING = 50
"""Deepest nesting of braces, brackets and parentheses."""
_GRAMMAR = r"""
start: _item*
_item: statement | SEMICOLON
statement: words? COMMENTED words? COMMENT -> to_commented
    | words SEMICOLON -> to_ended
    | words? body -> with_body
body: LBRACE _item* words? RBRACE
words: _word+
_word: KEYWORD | NAME | NUMBER | TEXT | SIGN | LPAR _inner* RPAR | LSQB _inner* RSQB | OPENED _inner* CLOSED
_inner: _word | SEMICOLON

NAME: /[^\W\d]\w*|'(?:[^'\\\n]|\\.)*'/
NUMBER: /(?:\d+\.\d+|\d+|\.\d+)(?:[eE][+-]?\d+)?/
TEXT: /"(?:[^"\\\n]|\\.)*"/
SIGN: /===|!==|:>>|::>|:>|::|:=|\.\.|\.\?|->|=>|==|!=|<=|>=|\?\?|\*\*|[:,=~@#*.+\-<>&|!?%^$]|\/(?![\/*])/
COMMENT: /\/\*.*?\*\//s
NOTE: /\/\/\*.*?\*\/|\/\/(?!\*)[^\n]*/s
BLANK: /[ \t\r\n\f]+/
LPAR: "("
RPAR: ")"
LSQB: "["
RSQB: "]"
LBRACE: "{"
RBRACE: "}"
SEMICOLON: ";"
%declare KEYWORD COMMENTED OPENED CLOSED
%ignore NOTE
%ignore BLANK
"""
"""KEYWORD is a reserved word; COMMENTED is in _WITH_COMMENT; OPENED and CLOSED are braces of expressions."""
_WITH_COMMENT = frozenset({"comment", "doc", "language", "locale", "rep"})
"""Words of statements that end with a comment."""
_SHARED = (
    "about abstract alias all and as binding by comment crosses default dependency derived doc else "
    "end false filter first flow for from hastype if implies import in inout istype language library "
    "locale meta metadata nonunique not null of or ordered out package private protected public "
    "redefines references rep return specializes standard subsets succession then to true xor"
)
_SYSML = (
    "accept action actor after allocate allocation analysis assert assign assume at attribute bind "
    "calc case concern connect connection constant constraint decide def defined do entry enum event "
    "exhibit exit expose fork frame include individual interface item join loop merge message "
    "objective occurrence parallel part perform port ref render rendering require requirement satisfy "
    "send snapshot stakeholder state subject terminate timeslice transition until use variant "
    "variation verification verify via view viewpoint when while"
)
_KERML = (
    "assoc behavior bool chains class classifier composite conjugate conjugates conjugation connector "
    "const datatype differences disjoining disjoint expr feature featured featuring function "
    "interaction intersects inv inverse inverting member metaclass multiplicity namespace portion "
    "predicate redefinition specialization step struct subclassifier subset subtype type typed typing "
    "unions var"
)
RESERVED_WORDS = frozenset(f"{_SHARED} {_SYSML}".split())
"""Words of SysML that must be quoted as names."""
_RESERVED_IN_KERML = frozenset(f"{_SHARED} {_KERML}".split())
_NO_RESULT = frozenset(
    {"action", "attribute", "enum", "item", "metadata", "package", "part", "port", "state", "@"}
)
"""Elements whose body has statements only, without a result expression."""
_OPENING = frozenset({"LBRACE", "LPAR", "LSQB", "OPENED"})
_CLOSED = frozenset({"CLOSED", "RBRACE", "RPAR", "RSQB"})
_KINDS = {"COMMENTED": "keyword", "KEYWORD": "keyword", "NAME": "name", "NUMBER": "number", "TEXT": "text"}
"""Kind of token -> kind of word; all others are signs."""
PREFIXES = frozenset(
    {"abstract", "constant", "derived", "end", "individual", "library", "private", "protected", "public"}
    | {"readonly", "ref", "standard", "variant", "variation"}
)
DIRECTIONS = frozenset({"in", "inout", "out"})
_DECLARING = frozenset({"=", ":=", ":", ":>", ":>>", "::>"})
"""Signs that occur in declarations, but never in expressions outside brackets."""
_IN_EXPRESSIONS = frozenset(
    {"all", "as", "false", "hastype", "if", "istype", "meta", "new", "not", "null"}
    | {"private", "protected", "public", "true"}
)
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "v": "\v"}
_ESCAPED = re.compile(r"\\(['\"\\])")
_CLOSING = {"(": ")", "[": "]", "{": "}"}
_UNCLOSED = {"//*": "a note", "/*": "a comment", '"': "a text", "'": "a name in quotation marks"}


@dataclass(frozen=True, slots=True)
class Word:
    """A word, number, text or sign with its position: line, and character range of the file."""

    kind: str
    """keyword, name, number, text or sign."""
    text: str
    line: int
    begin: int
    end: int

    @property
    def name(self) -> str:
        """The name without quotation marks; escaped line ends are kept, since names have one line."""
        return _ESCAPED.sub(r"\1", self.text[1:-1]) if self.text.startswith("'") else self.text


@dataclass(slots=True)
class Statement:
    """Words and the statements in the following braces; None if a semicolon ends the statement."""

    words: list[Word]
    line: int
    end: int
    """Position of the semicolon or the brace, in characters."""
    body: list["Statement"] | None = field(default=None)
    is_result: bool = False
    """Whether the statement is the result expression of a body."""


def unescape(text: str) -> str:
    r"""Replace escape sequences, such as `\t` by a tab."""
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match[1], match[1]), text)


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


def parse_statements(text: str, path: Path) -> list[Statement]:
    """Parse the statements of a text.

    Raises InputError with file, line and column for invalid text.
    """
    line: int | None
    column: int | None
    nesting = _Nesting(_RESERVED_IN_KERML if path.suffix.lower() == KERML else RESERVED_WORDS)
    try:
        parser = Lark(_GRAMMAR, parser="lalr", lexer="basic", postlex=nesting, transformer=_Statements())
        result: Any = parser.parse(text)
        return list(result)
    except UnexpectedCharacters as error:
        at: Any = error.pos_in_stream
        opened = next((noun for sign, noun in _UNCLOSED.items() if text.startswith(sign, at)), None)
        wrong = f"{text[at]!r} is unexpected" if opened is None else f"{opened} is not closed"
        line, column = error.line, error.column
    except UnexpectedToken as error:
        wrong, line, column = _describe_unexpected(error.token, nesting)
    except _TokenError as error:
        wrong, line, column = error.problem, error.token.line, error.token.column
    raise InputError(f"{path}:{line}:{column}: is not valid SysML: {wrong}")


def _describe_unexpected(token: Token, nesting: "_Nesting") -> tuple[str, int | None, int | None]:
    """Return the message for an unexpected token, with line and column."""
    before = token if token.type != "$END" or nesting.before is None else nesting.before
    if nesting.annotation is not None:
        word = nesting.annotation
        return f"{word.value!r} must be followed by a comment, /* .. */", word.line, word.column
    if token.type == "$END":
        return f"';' is missing after {_abbreviate(before)}", before.line, before.column
    return f"{_abbreviate(token)} is unexpected", token.line, token.column


def _abbreviate(token: Token) -> str:
    return repr(str(token) if len(token) <= 40 else f"{token[:40]}..")


class _TokenError(Exception):
    def __init__(self, token: Token, problem: str) -> None:
        super().__init__(problem)
        self.token, self.problem = token, problem


class _Statements(Transformer[Token, Any]):
    """Transforms each rule of the grammar."""

    def start(self, items: list[Any]) -> list[Statement]:
        return [word for word in items if isinstance(word, Statement)]

    def words(self, tokens: list[Token]) -> list[Token]:
        return tokens

    def to_commented(self, items: list[Any]) -> Statement:
        comment = items[-1]
        tokens = [token for part in items[:-1] for token in (part if isinstance(part, list) else [part])]
        return _statement(tokens, comment.end_pos)

    def to_ended(self, items: list[Any]) -> Statement:
        tokens, semicolon = items
        return _statement(tokens, semicolon.start_pos)

    def with_body(self, items: list[Any]) -> Statement:
        tokens: list[Token] = items[0] if len(items) > 1 else []
        brace, *inside, _ = items[-1]
        body = [word for word in inside if isinstance(word, Statement)]
        if inside and isinstance(inside[-1], list):  # the words of a result
            result = inside[-1]
            _check_result(tokens, result)
            body.append(_statement(result, result[-1].end_pos, is_result=True))
        if not tokens:
            return Statement([], brace.line, brace.start_pos, body)
        return _statement(tokens, brace.start_pos, body)

    def body(self, items: list[Any]) -> list[Any]:
        return items


def _statement(
    tokens: list[Any], end: int, body: list[Statement] | None = None, *, is_result: bool = False
) -> Statement:
    words = [
        Word(_KINDS.get(token.type, "sign"), str(token), token.line, token.start_pos, token.end_pos)
        for token in tokens
    ]
    return Statement(words, words[0].line, end, body, is_result)


def _check_result(owner: list[Token], result: list[Token]) -> None:
    """Raise _TokenError if the end of a body is a statement without its semicolon."""
    depth = 0
    declares = result[0].type == "KEYWORD" and str(result[0]) not in _IN_EXPRESSIONS
    for token in result:
        depth += (token.type in _OPENING) - (token.type in _CLOSED)
        declares = declares or (not depth and str(token) in _DECLARING)
    kind = next((str(part) for part in owner if str(part) not in PREFIXES | DIRECTIONS), "")
    if declares or kind in _NO_RESULT:
        raise _TokenError(result[-1], f"';' is missing after {_abbreviate(result[-1])}")


class _Nesting(PostLex):
    """Stage between lexer and parser: checks brackets, and marks the braces of expressions.

    Braces inside other brackets, and after `->NAME`, `.`, `.?` and `=`, contain an expression (KerML
    8.2.5.8).
    """

    always_accept = ()

    def __init__(self, reserved: frozenset[str]) -> None:
        self._reserved = reserved
        self._open: list[Token] = []
        self.before: Token | None = None
        """The last token."""
        self.annotation: Token | None = None
        """The word that requires a comment at the end of the current statement."""

    def process(self, stream: Iterable[Token]) -> Iterator[Token]:
        in_call = False  # after -> and the following name
        expressions = 0  # open brackets inside which all braces belong to expressions
        for token in stream:
            kind = token.type
            if kind == "COMMENT":
                if self.annotation is None:
                    continue  # comments have no meaning
                self.annotation = None
            elif kind == "NAME" and token.value in self._reserved:
                token.type = "KEYWORD"
                if token.value in _WITH_COMMENT and self.annotation is None and not expressions:
                    token.type, self.annotation = "COMMENTED", token
            elif kind in {"LPAR", "LSQB", "LBRACE"}:
                if len(self._open) >= _DEEPEST_NESTING:
                    raise _TokenError(token, f"nesting is deeper than {_DEEPEST_NESTING} levels")
                behind = "" if self.before is None else self.before.value
                if (
                    kind != "LBRACE"
                    or expressions
                    or behind in {".", ".?", "=", ":="}
                    or (in_call and behind != "->")
                ):
                    expressions += 1
                    token.type = "OPENED" if kind == "LBRACE" else kind
                self._open.append(token)
            elif kind in {"RPAR", "RSQB", "RBRACE"}:
                token.type = self._close(token)
                expressions -= expressions > 0
            in_call = token.value == "->" or (in_call and (kind == "NAME" or token.value == "::"))
            self.before = token
            yield token
        if self._open:
            opened = self._open[-1]
            raise _TokenError(opened, f"{opened.value!r} is not closed")

    def _close(self, token: Token) -> str:
        """Return the kind of a closing bracket. Raises _TokenError if it does not match."""
        opened = self._open.pop() if self._open else None
        if opened is None:
            raise _TokenError(token, f"{token.value!r} has no opening bracket")
        if _CLOSING[opened.value] != token.value:
            raise _TokenError(
                token,
                f"{token.value!r} found, expected {_CLOSING[opened.value]!r} for {opened.value!r} in line "
                f"{opened.line}",
            )
        return "CLOSED" if opened.type == "OPENED" else str(token.type)
