"""A server's standard output and error, every line marked with what was being computed."""

import io
import os
import re
import sys

from swarmwright.servers.supervision.progress import Sample

MARK = b"\x1e"
"""Delimits `request first episode` at the beginning of a line."""


_LINE = re.compile(rb"[^\n]*\n|[^\n]+")


class MarkedOutput(io.RawIOBase):
    """Writes to a file descriptor.

    Args:
        target: where to.
        progress: file descriptor of the process's progress.
    """

    def __init__(self, target: int, progress: int) -> None:
        super().__init__()
        self._target = target
        self._progress = progress
        self._in_line = False

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the file descriptor, which code that is not Python's writes to without marks."""
        return self._target

    def isatty(self) -> bool:
        """Return False: what is written is read by a program."""
        return False

    def write(self, data: "io._WriteBuffer") -> int:  # type: ignore[name-defined]
        """Write whole lines with marks; what goes on in a line has its mark already."""
        text = bytes(data)
        if not text:
            return 0
        place = Sample.read(self._progress)
        mark = b""
        if place.candidates:
            episode = "" if place.episode is None else str(place.episode)
            mark = MARK + f"{place.request} {place.first} {episode}".encode() + MARK
        lines = _LINE.findall(text)  # not at carriage returns, as progress bars have them
        marked = [line if self._in_line and not index else mark + line for index, line in enumerate(lines)]
        self._in_line = not text.endswith(b"\n")
        rest = memoryview(b"".join(marked))
        while rest:
            rest = rest[os.write(self._target, rest) :]
        return len(text)


def mark_output(progress: int) -> None:
    """Have what Python code prints marked.

    progress: file descriptor of this process's progress.
    """
    for name, target in (("stdout", 1), ("stderr", 2)):
        stream = io.BufferedWriter(MarkedOutput(target, progress))
        wrapped = io.TextIOWrapper(stream, "utf-8", "backslashreplace", line_buffering=True)
        setattr(sys, name, wrapped)
        setattr(sys, f"__{name}__", wrapped)
