"""A server's standard output and error, with a mark of the current work on every line."""

import io
import os
import re
import sys

from swarmwright.servers.supervision.progress import Sample

MARK = b"\x1e"
"""Delimits `request first episode` at the beginning of a line."""


_LINE = re.compile(rb"[^\n]*\n|[^\n]+")


class MarkedOutput(io.RawIOBase):
    """Stream that writes marked lines to a file descriptor.

    Args:
        target: file descriptor to write to.
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
        """Return the file descriptor, to which code outside Python writes without marks."""
        return self._target

    def isatty(self) -> bool:
        """Return False, as a program reads the output."""
        return False

    def write(self, data: "io._WriteBuffer") -> int:  # type: ignore[name-defined]
        """Write data with a mark at the beginning of each line."""
        text = bytes(data)
        if not text:
            return 0
        sample = Sample.read(self._progress)
        mark = b""
        if sample.candidates:
            episode = "" if sample.episode is None else str(sample.episode)
            mark = MARK + f"{sample.request} {sample.first} {episode}".encode() + MARK
        lines = _LINE.findall(text)  # carriage returns of progress bars do not split lines
        marked = [line if self._in_line and not index else mark + line for index, line in enumerate(lines)]
        self._in_line = not text.endswith(b"\n")
        remaining = memoryview(b"".join(marked))
        while remaining:
            remaining = remaining[os.write(self._target, remaining) :]
        return len(text)


def mark_output(progress: int) -> None:
    """Mark the output of Python code.

    progress: file descriptor of this process's progress.
    """
    for name, target in (("stdout", 1), ("stderr", 2)):
        stream = io.BufferedWriter(MarkedOutput(target, progress))
        wrapped = io.TextIOWrapper(stream, "utf-8", "backslashreplace", line_buffering=True)
        setattr(sys, name, wrapped)
        setattr(sys, f"__{name}__", wrapped)
