"""YAML 1.2 with line numbers: reports all problems of a file at once, each with its line."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from swarmwright.common._yaml_scanner import YamlParser, YamlScanner
from swarmwright.common.errors import InputError
from swarmwright.common.files import IS_UTF16, is_utf16, read_bytes, suggest_file

Path_ = tuple[str | int, ...]
"""The path to a value: keys and list indices from the top."""

LARGEST_FILE = 1 << 26
"""Largest size in bytes."""
LONGEST_NUMBER = 1000
"""Largest number of characters. Python does not write integers of more than 4300 digits."""
_MOST_VALUES = 1_000_000
"""Largest number of values of a file: nested aliases can make a short file endless."""
_TAG = "tag:yaml.org,2002:"
_PART = re.compile(r"[^.\[\]]+|\[\d+\]")
_WORDS = re.compile(r"[A-Za-z_](?:[A-Za-z0-9_]|[ ./-](?=[A-Za-z0-9_]))*")
_NO_TEXT = frozenset({"null", "true", "false", "yes", "no", "on", "off", "y", "n"})
_CONTROL = re.compile(r"[^\t\n -~\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")
_SURROGATE = re.compile("[\ud800-\udfff]")
_SEVERAL = "expected a single document in the stream"
"""The parser's message."""
_HINTS = {
    "mapping values are not allowed here": "; a colon followed by a space begins the value of a key: remove "
    "the space, as in gymnasium:CartPole-v1, put text with a colon into quotes, or correct the indentation",
    "expected <block end>": "; keys of a mapping, and items of a list, must begin in the same column",
}
"""Message of the parser -> remedy."""
LINE_CHARACTERS = 110
"""Largest number of characters of a line."""


@dataclass
class Source:
    """The values of a file with their lines."""

    name: str
    """The file as named by the user."""
    values: Any = None
    lines: dict[Path_, int] = field(default_factory=dict)
    """Line, from 1, of each key and list item."""
    problems: list[tuple[Path_, int, str]] = field(default_factory=list)
    """Problems of the YAML: path, line, message."""
    options: dict[Path_, str] = field(default_factory=dict)
    """The option of the command line for each value set by one, as typed."""
    above: Path_ = ()
    """For a part of a file: its path there, which precedes paths in messages."""

    def locate(self, path: Path_) -> str:
        """Return "file:line: a.b.c: " for the value at `path`, or "--set a.b.c=5: " if an option set it.

        A value without a line gets that of the nearest value above it.
        """
        above = self._nearest(path)
        dotted = format_path((*self.above, *path))
        if above in self.options:
            return f"{self.options[above]}: " + (f"{dotted}: " if path != above else "")
        line = self.lines.get(above)
        where = f"{self.name}:{line}: " if line is not None else f"{self.name}: " if self.name else ""
        return f"{where}{dotted}: " if dotted else where

    def order(self, path: Path_) -> tuple[int, int]:
        """Return a sort key for paths: by line, then those set by options in their order."""
        above = self._nearest(path)
        if above in self.options:
            return 1, list(self.options).index(above)
        return 0, self.lines.get(above, 0)

    def is_option(self, path: Path_) -> bool:
        """Return whether an option set the value at a path."""
        return self._nearest(path) in self.options

    def folder(self, path: Path_) -> Path:
        """Return the base folder of a relative file name at `path`: that of the file that names it."""
        return Path(self.name).parent if self.name and not self.is_option(path) else Path()

    def _nearest(self, path: Path_) -> Path_:
        """Return the path, or the nearest path with a known line or option."""
        while path and path not in self.options and path not in self.lines:
            below = next((option for option in self.options if option[: len(path)] == path), None)
            if below is not None:  # an option created this value
                return below
            path = path[:-1]
        return path


def format_path(path: Path_) -> str:
    """Format `("a", "b", 0)` as "a.b[0]"."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def parse_path(dotted: str) -> Path_:
    """Parse "a.b[0]" as `("a", "b", 0)`."""
    return tuple(int(part[1:-1]) if part[0] == "[" else part for part in _PART.findall(dotted))


def read(path: Path) -> Source:
    """Read a YAML file of one document.

    Raises InputError if the file cannot be read or is not valid YAML; duplicate keys and similar problems are
    collected in `problems`.
    """
    try:
        data = read_bytes(path, LARGEST_FILE)
        if is_utf16(data):
            raise InputError(f"{path}: {IS_UTF16}")
        text = data.decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file{suggest_file(path)}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, not a file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start} is invalid)") from error
    return parse(text, str(path))


def parse(text: str, name: str, most_values: int | None = None) -> Source:
    """Parse YAML text; `name` is its name in messages.

    Raises InputError if it is not valid YAML, or has more values, those that aliases repeat included.
    """
    return parse_node(compose(text, name), name, most_values)


def parse_node(node: Node | None, name: str, most_values: int | None = None) -> Source:
    """Return the values of a composed text; None composes an empty one. Raises InputError as `parse` does."""
    source = Source(name)
    if node is not None:
        source.values = _Builder(source, most_values or _MOST_VALUES).build(node, ())
    return source


def compose(text: str, name: str) -> Node | None:
    """Return the nodes of YAML text, which know their positions in it; None for an empty text.

    Raises InputError, with `name` and the line, if it is not valid YAML.
    """
    try:
        yaml = YAML(typ="safe", pure=True)
        yaml.Composer = _Composer
        yaml.Parser, yaml.Scanner = YamlParser, YamlScanner
        # The end of a file ends its last line, also in a block scalar.
        node: Node | None = yaml.compose(text if text.endswith("\n") else f"{text}\n")
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        location = f"{name}:{mark.line + 1}: " if mark is not None else f"{name}: "
        problem = str(error.problem or error.context)
        if isinstance(error, ComposerError) and error.context == _SEVERAL:
            raise InputError(f"{location}a second document begins here; only one is supported") from error
        hint = next((hint for words, hint in _HINTS.items() if words in problem), "")
        raise InputError(f"{location}is not valid YAML: {problem}{hint}") from error
    except ReaderError as error:
        line, character = text.count("\n", 0, error.position) + 1, ord(text[error.position])
        raise InputError(
            f"{name}:{line}: is not valid YAML: the character U+{character:04X} is not allowed"
        ) from error
    except (YAMLError, ValueError) as error:
        raise InputError(f"{name}: is not valid YAML: {error}") from error
    except RecursionError:
        raise InputError(f"{name}: is nested too deeply") from None
    return node


class _Composer(Composer):
    """A composer with a limit on the number of values."""

    _composed = 0

    def __init__(self, loader: Any = None) -> None:  # noqa: ANN401 - as its base class has it
        super().__init__(loader)
        self.warn_double_anchors = False  # a later one replaces it: YAML 1.2, 3.2.2.2

    def compose_node(self, parent: Any, index: Any) -> Any:  # noqa: ANN401 - as its base class has it
        self._composed += 1
        if self._composed > 2 * _MOST_VALUES:  # keys are nodes, too
            raise YAMLError(f"it holds more than {_MOST_VALUES} values")
        return super().compose_node(parent, index)

    def compose_scalar_node(self, anchor: Any) -> Any:  # noqa: ANN401 - as its base class has it
        event = self.parser.peek_event()
        if str(event.tag) == "!":
            event.implicit = (False, True)  # text, also if it looks like a number
        return super().compose_scalar_node(anchor)


class _Builder:
    """Converts the node graph to plain values; tags are never executed."""

    def __init__(self, source: Source, most_values: int) -> None:
        self._source = source
        self._most_values = most_values
        self._open: list[Node] = []
        self._count = 0

    def build(self, node: Node, path: Path_) -> Any:  # noqa: ANN401 - any YAML value
        self._count += 1
        if self._count > self._most_values:
            raise InputError(f"{self._source.name}: holds more than {self._most_values} values")
        if len(self._open) > 100:
            raise InputError(f"{self._source.name}: is nested too deeply")
        if any(node is above for above in self._open):
            self._problem(node, path, "an alias refers to a value that contains it")
            return None
        self._source.lines.setdefault(path, node.start_mark.line + 1)
        self._open.append(node)
        try:
            if isinstance(node, MappingNode | SequenceNode) and node.tag not in {f"{_TAG}map", f"{_TAG}seq"}:
                self._problem(node, path, f"the tag {node.tag} has no meaning here")
                return None
            if isinstance(node, MappingNode):
                return self._mapping(node, path)
            if isinstance(node, SequenceNode):
                return [self.build(item, (*path, index)) for index, item in enumerate(node.value)]
            return self._scalar(node, path)
        finally:
            self._open.pop()

    def _mapping(self, node: MappingNode, path: Path_) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode):
                self._problem(key_node, path, "a key must be a word, not a list or a mapping")
                continue
            key = self._text(key_node, path)
            inner = (*path, key)
            if key in result:
                first = self._source.lines[inner]
                self._problem(key_node, inner, f"duplicate key in one mapping (first in line {first})")
                continue
            self._source.lines[inner] = key_node.start_mark.line + 1
            result[key] = self.build(value_node, inner)
        return result

    def _scalar(self, node: Node, path: Path_) -> Any:  # noqa: ANN401 - any YAML scalar
        text = self._text(node, path)
        kind = str(node.tag).removeprefix(_TAG)
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() in {"true", "yes", "on"}
        try:
            if kind in {"int", "float"} and len(text) > LONGEST_NUMBER:
                shown = f"{text[:20]}.."
                self._problem(node, path, f"{shown} is a number of more than {LONGEST_NUMBER} characters")
                return None
            if kind == "int":
                return _integer(text)
            if kind == "float":
                return _number(text)
        except ValueError:
            self._problem(node, path, f"{text!r} is not a number")
            return None
        except OverflowError:
            self._problem(node, path, f"{text} is too large for a number")
            return None
        if kind in {"str", "timestamp", "value", "merge"}:
            return text
        self._problem(node, path, f"the tag {node.tag} has no meaning here")
        return None

    def _text(self, node: Node, path: Path_) -> str:
        """Return the text of a scalar; join surrogate escapes, as JSON writes characters above U+FFFF."""
        text: str = node.value
        if _SURROGATE.search(text):
            text = text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
            if "\ufffd" in text:
                self._problem(node, path, "an escape from \\ud800 to \\udfff is half of a character")
        return text

    def _problem(self, node: Node, path: Path_, message: str) -> None:
        self._source.problems.append((path, node.start_mark.line + 1, message))


def remove_locations(problems: str, name: str) -> str:
    """Remove the name and lines from problems of a text that is not in a file."""
    return re.sub(rf"{re.escape(name)}(:\d+)*: ", "", problems)


def _integer(text: str) -> int:
    digits = text.replace("_", "").lower()
    if digits.lstrip("+-")[:2] in {"0x", "0o", "0b"}:
        return int(digits, 0)
    return int(digits, 10)


def _number(text: str) -> float:
    special = {".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}
    lowered = text.replace("_", "").lower()
    if lowered in special:
        return special[lowered]
    number = float(lowered)
    if math.isinf(number):
        raise OverflowError
    return number


def dump(values: Mapping[str, Any]) -> str:
    """Format a mapping of plain values as YAML: a line per key, lists in brackets."""
    # ruamel.yaml takes 16 ms for a large experiment, longer than a short run: docs/decisions/013.
    return "".join(f"{line}\n" for line in _mapping_lines(values, "")) or "{}\n"


def _mapping_lines(values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, value in values.items():
        start = f"{indent}{_text(key)}:"
        if isinstance(value, Mapping) and value:
            yield start
            yield from _mapping_lines(value, indent + "  ")
        elif (
            isinstance(value, list)
            and len(value) > 1
            and len(start) + len(dump_flow(value)) >= LINE_CHARACTERS
        ):
            yield start
            yield from _wrap_list(value, indent + "  ")
        else:
            yield f"{start} {dump_flow(value)}"


def _wrap_list(values: list[Any], indent: str) -> Iterator[str]:
    """Break a long list between its items."""
    line = f"{indent}["
    for index, value in enumerate(values):
        item = f"{dump_flow(value)}{',' if index + 1 < len(values) else ']'}"
        if len(line) + len(item) >= LINE_CHARACTERS and line.strip() != "[":
            yield line.rstrip()
            line = f"{indent} "
        line += f"{item} "
    yield line.rstrip()


def dump_flow(value: Any) -> str:  # noqa: ANN401 - any plain value
    """Format a plain value as YAML in one line, in the style of JSON."""
    if isinstance(value, str):
        return _text(value)
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float):
        return _decimal(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(dump_flow, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_text(key)}: {dump_flow(inner)}' for key, inner in value.items())}}}"
    return str(value)


def _text(text: str) -> str:
    """Return a plain word unchanged, other text in quotes."""
    # Plain scalars with punctuation are not always read back unchanged.
    if _WORDS.fullmatch(text) and text.lower() not in _NO_TEXT:
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return _CONTROL.sub(lambda sign: f"\\U{ord(sign[0]):08X}", quoted)


def _decimal(number: float) -> str:
    if not math.isfinite(number):
        return ".nan" if math.isnan(number) else ".inf" if number > 0 else "-.inf"
    text = repr(number)
    # In YAML, 1e-05 is text and 1.0e-05 a number.
    return text if "." in text else text.replace("e", ".0e")
