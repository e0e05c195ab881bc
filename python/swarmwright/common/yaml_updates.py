"""New values in YAML text, which keeps its comments and its layout where the values stay."""

import json
from collections.abc import Mapping
from difflib import SequenceMatcher
from io import StringIO
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import LINE_CHARACTERS, dump, parse


def update_text(text: str, values: Mapping[str, Any]) -> str:
    """Return a text with these values, which keeps what it can of another text.

    Args:
        text: YAML, possibly of other values, or no valid YAML at all. Its values must be few: those that
            aliases repeat are compared one by one.
        values: plain.
    """
    plain = dump(values)
    expected = _comparable(parse(plain, "text").values)
    try:
        if _comparable(parse(text, "text").values) == expected:
            return text
        writer = _make_writer()
        stream = StringIO()
        writer.dump(_merge(writer.load(text), values), stream)
        updated = stream.getvalue()
        if _comparable(parse(updated, "text").values) == expected:
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
    return old if _comparable(old) == _comparable(new) else _make_node(new)


def _merge_items(old: CommentedSeq, new: list[Any]) -> None:
    """Change the items of a list; those that are equal keep their comments also where others come or go."""
    matcher = SequenceMatcher(None, [*map(_comparable, old)], [*map(_comparable, new)], autojunk=False)
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


def _comparable(value: Any) -> str:  # noqa: ANN401 - any plain value
    return json.dumps(value)
