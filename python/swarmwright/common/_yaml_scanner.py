"""YAML 1.2 where ruamel.yaml's scanner and parser implement YAML 1.1 or refuse valid text.

Overrides the cases that fail in the YAML test suite: tabs as separation, directives, colons and question
marks in flow collections, multi-line keys, tags before a comma, blank lines before a block scalar.
"""

import re
from typing import Any
from urllib.parse import unquote

from ruamel.yaml.parser import Parser
from ruamel.yaml.scanner import Scanner, ScannerError
from ruamel.yaml.tokens import (
    DirectiveToken,
    DocumentEndToken,
    FlowEntryToken,
    FlowMappingEndToken,
    FlowSequenceEndToken,
    FlowSequenceStartToken,
    KeyToken,
    ScalarToken,
    TagToken,
)

_BREAKS = "\r\n\x85\u2028\u2029"
_END = f"\0{_BREAKS}"
_END_OR_WHITE = f"{_END} \t"
_FLOW = ",[]{}"
_INDICATORS = f"{_END_OR_WHITE}-?:{_FLOW}#&*!|>'\"%@`"
_LONGEST_KEY = 1024
"""Largest number of characters of a key without ?."""
_VERSION = re.compile(r"(\d{1,9})\.\d{1,9}")
_HANDLE = re.compile(r"!([\w-]*!)?", re.ASCII)
_URI = re.compile(r"[\w\-#;/?:@&=+$,.!~*'()\[\]%]+", re.ASCII)

TABS = "a tab cannot be used for indentation; indent YAML with spaces"


class YamlScanner(Scanner):
    """Tokens of YAML 1.2."""

    _tab_line = -1
    """The last line with a tab where a block collection could begin; it must not begin there."""
    _last_token: Any = None

    def get_token(self) -> Any:  # noqa: ANN401 - here and below as in the base class
        self._last_token = super().get_token()
        return self._last_token

    def stale_possible_simple_keys(self) -> None:
        reader = self.reader
        for level, key in list(self.possible_simple_keys.items()):
            in_mapping = level > 0 and self.flow_context[level - 1] == "{"
            if (key.line != reader.line and not in_mapping) or reader.index - key.index > _LONGEST_KEY:
                if key.required:
                    raise ScannerError(
                        "while scanning a simple key",
                        key.mark,
                        "could not find expected ':'",
                        reader.get_mark(),
                    )
                del self.possible_simple_keys[level]

    def fetch_value(self) -> None:
        has_key = self.flow_level in self.possible_simple_keys
        if not self.flow_level and not has_key and self._tab_line == self.reader.line:
            raise self._error(TABS)
        if self.flow_level and self.flow_context[-1] == "[" and not has_key:
            previous = self._previous()
            if isinstance(previous, FlowSequenceStartToken | FlowEntryToken):  # [: value] has an empty key
                mark = self.reader.get_mark()
                self.tokens.append(KeyToken(mark, mark))
        super().fetch_value()

    def check_key(self) -> bool:
        return self.reader.peek(1) in _END_OR_WHITE

    def check_value(self) -> bool:
        after = self.reader.peek(1)
        if after in _END_OR_WHITE or (self.flow_level and after in _FLOW):
            return True
        previous = self._previous()
        is_json = (isinstance(previous, ScalarToken) and not previous.plain) or isinstance(
            previous, FlowSequenceEndToken | FlowMappingEndToken
        )  # in flow collections, a value may follow such a key without a space
        return is_json and self.flow_level > 0 and self.flow_level in self.possible_simple_keys

    def check_plain(self) -> bool:
        first, second = self.reader.peek(), self.reader.peek(1)
        if first not in _INDICATORS:
            return True
        return first in "-?:" and second not in _END_OR_WHITE and not (self.flow_level and second in _FLOW)

    def scan_to_next_token(self) -> None:
        reader = self.reader
        peek, forward = reader.peek, reader.forward
        if reader.index == 0 and peek() == "\ufeff":
            forward()
        while True:
            while peek() == " ":
                forward()
            if peek() == "\t":
                self._skip_tabs()
            if peek() == "#":
                if reader.column and reader.buffer[reader.pointer - 1] not in " \t":
                    raise self._error("a comment needs a space before its #")
                while peek() not in _END:
                    forward()
            if not self.scan_line_break():
                return
            if not self.flow_level:
                self.allow_simple_key = True

    def _skip_tabs(self) -> None:
        """Skip white space that begins with a tab, which separates text but is no indentation."""
        reader = self.reader
        if not self.flow_level and self.allow_simple_key and not self._rest_is_blank():
            before = reader.buffer[reader.pointer - reader.column : reader.pointer]
            if reader.column <= self.indent and not before.strip(" "):
                raise self._error(TABS)
            self.allow_simple_key = False
            self._tab_line = reader.line
        while reader.peek() in " \t":
            reader.forward()
        if self._tab_line == reader.line and reader.peek() in "-?" and reader.peek(1) in _END_OR_WHITE:
            raise self._error(TABS)

    def _rest_is_blank(self) -> bool:
        """Return whether only white space and a comment follow in this line."""
        length = 0
        while self.reader.peek(length) in " \t":
            length += 1
        return self.reader.peek(length) in _END + "#"

    def scan_directive(self) -> DirectiveToken:
        reader = self.reader
        start = reader.get_mark()
        length = 0
        while reader.peek(length) not in _END:
            length += 1
        line = reader.prefix(length)
        name, *words = re.sub(r"[ \t]#.*", "", line[1:]).split() or [""]
        value: tuple[Any, ...] | None = None
        if name == "YAML":
            version = _VERSION.fullmatch(words[0]) if len(words) == 1 else None
            if version is None:
                raise self._error("expected a version after %YAML, such as %YAML 1.2")
            if int(version[1]) != 1:
                raise self._error(f"%YAML {words[0]}: only YAML 1.2 is supported")
            value = (1, 2)  # the specification: read other minor versions as the known one
        elif name == "TAG":
            if len(words) != 2 or not _HANDLE.fullmatch(words[0]) or not _URI.fullmatch(words[1]):
                raise self._error(
                    "expected a handle and a prefix after %TAG, such as %TAG !e! tag:example.com,2000:"
                )
            value = (words[0], _decode(words[1]))
        elif not name or name[0] == "#":
            raise self._error("expected the name of a directive after %")
        reader.forward(length)
        end = reader.get_mark()
        self.scan_line_break()
        return DirectiveToken(name, value, start, end)

    def scan_tag(self) -> TagToken:
        reader = self.reader
        start = reader.get_mark()
        length = 1
        if reader.peek(1) == "<":
            while reader.peek(length) not in _END_OR_WHITE + ">":
                length += 1
            handle, suffix = None, reader.prefix(length)[2:]
            if reader.peek(length) != ">" or not _URI.fullmatch(suffix):
                raise self._error("expected a tag, such as !<tag:example.com,2000:name>")
            length += 1
        else:
            while reader.peek(length) not in _END_OR_WHITE + _FLOW:
                length += 1
            text = reader.prefix(length)
            second = text.find("!", 1) + 1
            handle, suffix = (text[:second], text[second:]) if second else ("!", text[1:])
            if text == "!":
                handle, suffix = None, "!"
            elif not _HANDLE.fullmatch(handle) or not _URI.fullmatch(suffix):
                raise self._error(f"expected a tag, such as !name, but found {text[:60]}")
        after = reader.peek(length)
        if after not in _END_OR_WHITE and not (self.flow_level and after in ",]}"):
            raise self._error(f"expected a space after a tag, but found {after!r}")
        reader.forward(length)
        return TagToken((handle, _decode(suffix)), start, reader.get_mark())

    def scan_block_scalar_indicators(self, start_mark: Any) -> tuple[bool | None, int | None]:  # noqa: ANN401
        reader = self.reader
        chomping = increment = None
        while reader.peek() not in _END_OR_WHITE:
            character = reader.peek()
            if character in "+-" and chomping is None:
                chomping = character == "+"
            elif character in "123456789" and increment is None:
                increment = int(character)
            else:
                raise ScannerError(
                    "while scanning a block scalar",
                    start_mark,
                    f"expected +, - or the indentation, 1 to 9, but found {character!r}",
                    reader.get_mark(),
                )
            reader.forward()
        return chomping, increment

    def scan_block_scalar_ignored_line(self, start_mark: Any) -> None:  # noqa: ANN401
        reader = self.reader
        while reader.peek() in " \t":
            reader.forward()
        if reader.peek() == "#":
            while reader.peek() not in _END:
                reader.forward()
        if reader.peek() not in _END:
            raise ScannerError(
                "while scanning a block scalar",
                start_mark,
                "expected the end of the line: the text begins in the next one",
                reader.get_mark(),
            )
        self.scan_line_break()

    def scan_block_scalar_indentation(self) -> tuple[list[str], int, Any]:
        reader = self.reader
        breaks: list[str] = []
        blank = 0
        end = reader.get_mark()
        while reader.peek() in f" {_BREAKS}":
            if reader.peek() == " ":
                reader.forward()
                continue
            blank = max(blank, reader.column)
            breaks.append(self.scan_line_break())
            end = reader.get_mark()
        if self.indent < reader.column < blank and reader.peek() != "\0":
            raise self._error("the blank lines before this one have more spaces")
        return breaks, max(blank, reader.column), end

    def scan_flow_scalar_non_spaces(self, double: Any, start_mark: Any) -> list[str]:  # noqa: ANN401
        try:
            chunks: list[str] = super().scan_flow_scalar_non_spaces(double, start_mark)
        except (ValueError, OverflowError):
            raise self._error("expected the number of a character after \\x, \\u or \\U") from None
        return chunks

    def scan_plain(self) -> ScalarToken:
        reader = self.reader
        peek = reader.peek
        start = end = reader.get_mark()
        indent = self.indent + 1
        stops = _END_OR_WHITE + _FLOW if self.flow_level else _END_OR_WHITE
        chunks: list[str] = []
        spaces: list[str] = []
        while peek() != "#":
            length = 0
            while (character := peek(length)) not in stops:
                if character == ":" and peek(length + 1) in stops:
                    break
                length += 1
            if not length:
                break
            self.allow_simple_key = False
            chunks += [*spaces, reader.prefix(length)]
            reader.forward(length)
            end = reader.get_mark()
            spaces = self.scan_plain_spaces(indent, start)
            if not spaces or (not self.flow_level and reader.column < indent):
                break
        return ScalarToken("".join(chunks), True, start, end)

    def scan_plain_spaces(self, indent: int, start_mark: Any) -> list[str]:  # noqa: ANN401, ARG002
        reader = self.reader
        peek, forward = reader.peek, reader.forward
        length = 0
        while peek(length) in " \t":
            length += 1
        white = reader.prefix(length)
        forward(length)
        if peek() not in _BREAKS:
            return [white] if white else []
        line_break = self.scan_line_break()
        self.allow_simple_key = True
        breaks: list[str] = []
        if self._is_at_document_marker():
            return []
        while peek() in f" \t{_BREAKS}":
            if peek() in _BREAKS:
                breaks.append(self.scan_line_break())
                if self._is_at_document_marker():
                    return []
            elif peek() == " ":
                forward()
            elif not self.flow_level and reader.column < indent and not self._rest_is_blank():
                raise self._error(TABS)
            else:
                while peek() in " \t":
                    forward()
        first = [line_break] if line_break != "\n" else [] if breaks else [" "]
        return first + breaks

    def _is_at_document_marker(self) -> bool:
        return bool(self.check_document_start() or self.check_document_end())

    def _previous(self) -> Any:  # noqa: ANN401 - ruamel.yaml's tokens are not typed
        """Return the token before the current one."""
        return self.tokens[-1] if self.tokens else self._last_token

    def _error(self, problem: str) -> ScannerError:
        return ScannerError(None, None, problem, self.reader.get_mark())


class YamlParser(Parser):
    """Events of YAML 1.2."""

    def parse_implicit_document_start(self) -> Any:  # noqa: ANN401
        while self.scanner.check_token(DocumentEndToken):  # ends of documents without a document
            self.scanner.get_token()
        return super().parse_implicit_document_start()


def _decode(uri: str) -> str:
    """Decode escapes such as %21 in a part of a tag."""
    return unquote(uri, errors="replace")
