"""Kinds of messages: those that say the same of different servers, episodes, times or files."""

import re

_ADDRESS = re.compile(r"(?<!\w)0[xX][0-9a-fA-F]+")
"""Of memory, such as that of an invalid pointer."""
_PATH = re.compile(r"(?<![\w.])(?<!:(?=//))(?<!:/)(?:/[^\s;:,|'\")/]+)*/([^\s;:,|'\")/]*)")
"""An absolute path, which is no part of a URL; its last part is a group."""
_NUMBERED = re.compile(r"\d[a-zA-Z0-9]*")
"""In the name of a file: also what follows a digit, which names of temporary files have."""
_NUMBER = re.compile(r"(?<!status )(?<!exit code )(?<!signal )(?<!HTTP )(?<!\d)\d+(\.\d+)?([eE][+-]?\d+)?")
"""Not a status, a signal or an exit code, which is a reason of its own."""


def kind_of(message: str) -> str:
    """Return what messages of one kind have in common.

    Their text without numbers and addresses of memory, except for statuses, exit codes and signals; of
    absolute paths the last part stays, which tells files of an experiment apart.
    """
    named = _PATH.sub(lambda path: f"/{_NUMBERED.sub('0', path[1])}", _ADDRESS.sub("0", message))
    return _NUMBER.sub("0", named)
