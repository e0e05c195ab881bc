"""Changes of single values in YAML text, which keep its comments, its order and its layout.

Each change replaces a part of the text, and is checked: the new text, read back, has the new value, and
otherwise the values that it had.
"""

import copy
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from io import StringIO
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import (
    LINE_CHARACTERS,
    Source,
    compose,
    dump,
    dump_flow,
    format_path,
    parse,
    parse_node,
)

_NAME = "text"
_COLON = re.compile(r"[ \t]*:")
_ALIAS = re.compile(r"[ \t]*\*[^\s,\[\]{}]+")
_COMMENT = re.compile(r"( +)#")
_BOM = "\ufeff"


@dataclass(frozen=True)
class _Entry:
    """A key of a mapping with its value."""

    key: ScalarNode
    value: Node

    @property
    def name(self) -> str:
        return str(self.key.value)

    @property
    def is_alias(self) -> bool:
        """Whether the value stands at an anchor before."""
        return bool(self.value.start_mark.index < self.key.end_mark.index)


def set_value(text: str, path: Sequence[str], value: Any, order: Sequence[str] = ()) -> str:  # noqa: ANN401
    """Return a text with another value at a path.

    Mappings that are missing are added; a text, number or list on the way gives way to a mapping.

    Args:
        text: YAML, a mapping or empty.
        path: keys, from the top.
        value: plain; a mapping or list replaces the whole former value.
        order: keys of the mapping that has the last part of the path which is new: it is put after those
            that precede it here, otherwise at the end.

    Raises InputError when the text is not valid YAML, or the value cannot be set without a change of other
    values, as in a mapping that is repeated by an alias.
    """
    document = _Document(text, path)
    result = document.replace_value(value, order)
    return document.check(result, _assign(document.values, path, value))


def remove_value(text: str, path: Sequence[str]) -> str:
    """Return a text without a key; mappings that would be empty are removed as well.

    A text that has no such key is returned as it is. Raises InputError as `set_value`.
    """
    document = _Document(text, path)
    values: Any = document.values
    for key in path:
        if not isinstance(values, Mapping) or key not in values:
            return text
        values = values[key]
    depth = len(path)
    while depth > 1 and len(_value_at(document.values, path[: depth - 1])) == 1:
        depth -= 1
    return document.check(document.drop_keys(depth), _remove(document.values, path[:depth]))


class _Document:
    """A text with its nodes, and the path that is changed."""

    def __init__(self, text: str, path: Sequence[str]) -> None:
        self._bom = _BOM if text.startswith(_BOM) else ""
        self._text = text.removeprefix(_BOM)
        if self._text and not self._text.endswith("\n"):
            self._text += "\n"
        self._newline = "\r\n" if "\r\n" in self._text else "\n"
        self._path = tuple(path)
        self._root = compose(self._text, _NAME)
        source = parse_node(self._root, _NAME)
        _require_plain(source)
        if not isinstance(source.values, Mapping | None):
            raise InputError("must be a mapping of keys")
        if self._root is not None and not isinstance(self._root, MappingNode):  # only `---` or `null`
            raise InputError("must be a mapping of keys, not empty")
        self.values: dict[str, Any] = dict(source.values or {})

    def check(self, result: str, expected: Mapping[str, Any]) -> str:
        """Return a new text. Raises InputError if its values are not as expected."""
        try:
            source = parse_node(compose(result, _NAME), _NAME)
            _require_plain(source)
            is_right = _comparable(source.values or {}) == _comparable(expected)
        except InputError:
            is_right = False
        if not is_right:
            raise InputError(
                f"{format_path(self._path)}: cannot be changed without changing other parts; change the text"
            )
        return self._bom + result

    def replace_value(self, value: Any, order: Sequence[str]) -> str:  # noqa: ANN401 - any plain value
        if self._root is None:
            return self._text + self._lines(_nest(self._path, value), 0)
        mapping, rest = self._find_mapping(self._path)
        entry = _find(mapping, rest[0])
        if entry is None:
            return self._insert(mapping, rest[0], _nest(rest[1:], value), order)
        return self._replace(mapping, entry, _nest(rest[1:], value))

    def drop_keys(self, depth: int) -> str:
        """Return the text without the first `depth` keys of the path."""
        mapping, rest = self._find_mapping(self._path[:depth])
        entries = _entries(mapping)
        index = next(index for index, entry in enumerate(entries) if entry.name == rest[0])
        entry = entries[index]
        start, end = entry.key.start_mark.index, self._end(entry)
        following = entries[index + 1].key.start_mark.index if index + 1 < len(entries) else None
        if mapping.flow_style:
            if following is not None:
                return self._splice(start, following, "")
            return self._splice(self._end(entries[index - 1]) if index else start, end, "")
        line = self._text.rfind("\n", 0, start) + 1
        if self._text[line:start].strip():  # the first key of an item of a list
            return self._splice(start, end if following is None else following, "")
        return self._splice(line, self._line_end(end), "")

    def _find_mapping(self, path: tuple[str, ...]) -> tuple[MappingNode, tuple[str, ...]]:
        """Return the innermost mapping on a path, and the part of the path that is below it."""
        node = self._root
        assert isinstance(node, MappingNode)
        for depth, key in enumerate(path[:-1]):
            entry = _find(node, key)
            if entry is None or not isinstance(entry.value, MappingNode) or entry.is_alias:
                return node, path[depth:]
            node = entry.value
        return node, path[-1:]

    def _insert(self, mapping: MappingNode, key: str, value: Any, order: Sequence[str]) -> str:  # noqa: ANN401
        entries = _entries(mapping)
        if mapping.flow_style:
            addition = dump_flow({key: value})[1:-1]
            at = self._end(entries[-1]) if entries else mapping.start_mark.index + 1
            return self._splice(at, at, f", {addition}" if entries else addition)
        previous = entries[-1]
        if key in order:
            preceding = set(order[: order.index(key)])
            previous = next((entry for entry in reversed(entries) if entry.name in preceding), previous)
        at = self._line_end(self._end(previous))
        lines = self._lines({key: value}, entries[0].key.start_mark.column)
        is_apart = mapping is self._root and isinstance(value, Mapping)
        if is_apart and self._newline * 2 in self._text:
            lines = self._newline + lines
        return self._splice(at, at, lines)

    def _replace(self, mapping: MappingNode, entry: _Entry, value: Any) -> str:  # noqa: ANN401 - any plain value
        node, flow = entry.value, dump_flow(value)
        colon = self._colon(entry)
        if entry.is_alias:
            alias = _ALIAS.match(self._text, colon)
            return self._splice(colon, alias.end() if alias else colon, f" {flow}")
        if _is_empty(node):
            if isinstance(value, Mapping) and value and not mapping.flow_style:
                at = self._line_end(colon)
                return self._splice(at, at, self._lines(value, entry.key.start_mark.column + 2))
            return self._splice(colon, colon, f" {flow}")
        start, end = node.start_mark.index, self._end(entry)
        if isinstance(node, MappingNode | SequenceNode) and not node.flow_style:
            line = self._line_end(colon)  # a comment beside the key stays
            rest = self._text[colon:line] + self._text[self._line_end(end) :]
            return f"{self._text[:colon]} {flow}{rest}"
        if _is_block(node):
            return self._splice(start, end, flow + self._newline)
        comment = _COMMENT.match(self._text, end)
        if comment is not None:  # stays in its column
            spaces = max(1, len(comment[1]) - len(flow) + end - start)
            return self._splice(start, comment.end() - 1, flow + " " * spaces)
        return self._splice(start, end, flow)

    def _splice(self, start: int, end: int, text: str) -> str:
        return self._text[:start] + text + self._text[end:]

    def _lines(self, values: Mapping[str, Any], indent: int) -> str:
        return "".join(f"{' ' * indent}{line}{self._newline}" for line in dump(values).splitlines())

    def _colon(self, entry: _Entry) -> int:
        """Return the position after the colon of a key."""
        match = _COLON.match(self._text, entry.key.end_mark.index)
        return int(entry.key.end_mark.index) if match is None else match.end()

    def _end(self, entry: _Entry) -> int:
        """Return the position after a value, without comments that follow it."""
        if entry.is_alias:
            alias = _ALIAS.match(self._text, self._colon(entry))
            return self._colon(entry) if alias is None else alias.end()
        return self._colon(entry) if _is_empty(entry.value) else self._node_end(entry.value)

    def _node_end(self, node: Node) -> int:
        if isinstance(node, MappingNode) and not node.flow_style and node.value:
            return self._end(_entries(node)[-1])
        if isinstance(node, SequenceNode) and not node.flow_style and node.value:
            return self._node_end(node.value[-1])
        end = int(node.end_mark.index)
        while _is_block(node):  # comments that follow do not belong to it
            line = self._text.rfind("\n", 0, end - 1) + 1
            if not self._text[line:end].startswith("#") and self._text[line:end].strip():
                break
            end = line
        return end

    def _line_end(self, position: int) -> int:
        """Return the beginning of the next line, or the position itself if it begins a line."""
        if position and self._text[position - 1] == "\n":
            return position
        ending = self._text.find("\n", position)
        return len(self._text) if ending < 0 else ending + 1


def _entries(mapping: MappingNode) -> list[_Entry]:
    return [_Entry(key, value) for key, value in mapping.value]


def _find(mapping: MappingNode, key: str) -> _Entry | None:
    return next((entry for entry in _entries(mapping) if entry.name == key), None)


def _is_empty(node: Node) -> bool:
    """Return whether a value is left out."""
    return isinstance(node, ScalarNode) and bool(node.start_mark.index == node.end_mark.index)


def _is_block(node: Node) -> bool:
    return isinstance(node, ScalarNode) and node.style in {"|", ">"}


def _require_plain(source: Source) -> None:
    """Raise InputError for mistakes in YAML that can be read, such as a duplicate key."""
    if source.problems:
        path, line, message = source.problems[0]
        raise InputError(f"{_NAME}:{line}: {format_path(path)}: {message}")


def _nest(path: Sequence[str], value: Any) -> Any:  # noqa: ANN401 - any plain value
    for key in reversed(path):
        value = {key: value}
    return value


def _value_at(values: Mapping[str, Any], path: Sequence[str]) -> Any:  # noqa: ANN401 - any plain value
    for key in path:
        values = values[key]
    return values


def _assign(values: Mapping[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:  # noqa: ANN401
    changed = copy.deepcopy(dict(values))
    container = changed
    for key in path[:-1]:
        if not isinstance(container.get(key), dict):
            container[key] = {}
        container = container[key]
    container[path[-1]] = value
    return changed


def _remove(values: Mapping[str, Any], path: Sequence[str]) -> dict[str, Any]:
    changed = copy.deepcopy(dict(values))
    del _value_at(changed, path[:-1])[path[-1]]
    return changed


def _comparable(value: Any) -> str:  # noqa: ANN401 - any plain value
    """Return a text that is the same for the same values, also NaN; 1 and 1.0 differ."""
    return json.dumps(value, sort_keys=True)


def update_text(text: str, values: Mapping[str, Any]) -> str:
    """Return a text with these values, which keeps what it can of another text.

    Args:
        text: YAML, possibly of other values, or no valid YAML at all. Its values must be few: those that
            aliases repeat are compared one by one.
        values: plain.
    """
    plain = dump(values)
    expected = json.dumps(parse(plain, "text").values)
    try:
        if json.dumps(parse(text, "text").values) == expected:
            return text
        writer = _make_writer()
        stream = StringIO()
        writer.dump(_merge(writer.load(text), values), stream)
        updated = stream.getvalue()
        if json.dumps(parse(updated, "text").values) == expected:
            return updated
    except (InputError, YAMLError, ValueError, TypeError, AttributeError):
        pass  # what an alias repeats cannot be changed in one of its places
    return plain


def _make_writer() -> YAML:
    writer = YAML(typ="rt")
    writer.preserve_quotes = True
    writer.width = LINE_CHARACTERS
    writer.indent(mapping=2, sequence=4, offset=2)
    return writer


def _merge(old: Any, new: Any) -> Any:  # noqa: ANN401 - any plain value
    """Return an old value with its comments, changed to a new one."""
    if isinstance(old, CommentedMap) and isinstance(new, Mapping) and new:
        for key in [key for key in old if key not in new]:
            del old[key]
        for key, value in new.items():
            old[key] = _merge(old[key], value) if key in old else _make_node(value)
        return old
    if isinstance(old, CommentedSeq) and isinstance(new, list) and new:
        _merge_items(old, new)
        return old
    return old if json.dumps(old) == json.dumps(new) else _make_node(new)


def _merge_items(old: CommentedSeq, new: list[Any]) -> None:
    """Change the items of a list; those that are equal keep their comments also where others come or go."""
    matcher = SequenceMatcher(None, [*map(json.dumps, old)], [*map(json.dumps, new)], autojunk=False)
    for kind, start, end, new_start, new_end in reversed(matcher.get_opcodes()):
        if kind == "equal":
            continue
        both = min(end - start, new_end - new_start)
        for index in reversed(range(start + both, end)):
            del old[index]
        for index, value in enumerate(new[new_start + both : new_end], start + both):
            old.insert(index, _make_node([value])[0])  # in one line
        for offset in range(both):
            old[start + offset] = _merge(old[start + offset], new[new_start + offset])


def _make_node(value: Any) -> Any:  # noqa: ANN401 - any plain value
    """Return a value in the layout that `dump` gives it."""
    return _make_writer().load(dump({"value": value}))["value"]
