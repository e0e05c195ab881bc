"""Kinds of messages, which differ only in servers, episodes, times or files."""

import re

_ADDRESS = re.compile(r"(?<!\w)0[xX][0-9a-fA-F]+")
"""An address in memory, such as that of an invalid pointer."""
_PATH = re.compile(r"(?<![\w.])(?<!:(?=//))(?<!:/)(?:/[^\s;:,|'\")/]+)*/([^\s;:,|'\")/]*)")
"""An absolute path outside of URLs; its last part is a group."""
_NUMBERED = re.compile(r"\d[a-zA-Z0-9]*")
"""In a file name: a digit and the following characters, which names of temporary files have."""
_NUMBER = re.compile(r"(?<!status )(?<!exit code )(?<!signal )(?<!HTTP )(?<!\d)\d+(\.\d+)?([eE][+-]?\d+)?")
"""A number, except for statuses, signals and exit codes, which are reasons."""


def kind_of(message: str) -> str:
    """Return the text that messages of one kind share.

    Numbers and memory addresses are replaced, except for statuses, exit codes and signals. Absolute paths are
    reduced to their last part, which distinguishes files of an experiment.
    """
    named = _PATH.sub(lambda path: f"/{_NUMBERED.sub('0', path[1])}", _ADDRESS.sub("0", message))
    return _NUMBER.sub("0", named)
