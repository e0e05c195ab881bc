"""Escaped output of text from peers and files, so that it can neither control a terminal nor imitate a line.

Servers and tools choose their titles, names and reasons freely, and so do files. A terminal interprets escape
sequences (ESC and C1), line breaks, and Unicode's direction marks.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

_BEYOND_C0 = (
    "\x7f-\x9f"  # DEL, C1
    "\u2028\u2029"  # breaks of lines and paragraphs
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # marks of direction
)
_IN_LINE = re.compile(f"[\x00-\x1f{_BEYOND_C0}]")
_IN_JSON = re.compile(f"[{_BEYOND_C0}]")
_NAMES = {"\n": r"\n", "\r": r"\r", "\t": r"\t"}


def escape_line(text: str) -> str:
    r"""Escape text as a single line: a line break is `\n`, ESC is `\x1b`, U+202E is `\u202e`."""
    return _IN_LINE.sub(lambda found: _NAMES.get(found[0]) or _escape(found[0]), text)


def escape_lines(text: str) -> list[str]:
    """Return the lines of a multi-line text, each escaped except for tabs.

    The caller must indent them: at the left margin they could imitate a line of Swarmwright.
    """
    return ["\t".join(map(escape_line, line.split("\t"))) for line in text.removesuffix("\n").split("\n")]


def escape_json(encoded: str) -> str:
    r"""Escape characters that JSON permits unescaped, as `\u009b`; the value stays the same."""
    return _IN_JSON.sub(lambda found: f"\\u{ord(found[0]):04x}", encoded)


def leads_elsewhere(text: str) -> bool:
    """Return whether a text, used as a relative path, leads out of its folder."""
    return text.startswith(("/", "~")) or ".." in PurePath(text).parts


def find_outside_paths(value: Any) -> Iterator[str]:  # noqa: ANN401 - any JSON value
    """Yield the texts in a value that, used as relative paths, lead out of their folder."""
    if isinstance(value, str):
        if leads_elsewhere(value):
            yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from find_outside_paths(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from find_outside_paths(item)


def _escape(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
