"""What a command prints: passed on to this process's log, the last of it kept, too much of it refused."""

import os
import sys
from collections import deque

LINES, _LINE = 20, 400
"""Lines that are kept of the end, and characters of each."""
_PIECE = 1 << 16
_SUMMARY = 3
"""Lines in a reason."""


class Printed:
    """The output of one process.

    Args:
        most: bytes that it may print.
        keep: whether to keep all of it, for a log.
    """

    def __init__(self, most: int, *, keep: bool = False) -> None:
        self._most = most
        self._count = 0
        self._line = b""
        self._last: deque[str] = deque(maxlen=LINES)
        self.all = bytearray() if keep else None

    @property
    def is_too_much(self) -> bool:
        """Whether the process has printed more than it may."""
        return self._count > self._most

    def read(self, descriptor: int) -> bool:
        """Take what can be read; return False at the end."""
        data = os.read(descriptor, _PIECE)
        self.take(data)
        return bool(data)

    def take(self, data: bytes) -> None:
        """Take a piece of the output."""
        if self.is_too_much:
            return
        self._count += len(data)
        if self.all is not None:
            self.all += data
        *lines, self._line = (self._line + data).split(b"\n")
        for line in lines:
            self._tell(line)
        if len(self._line) > _PIECE:
            self._tell(self._line)
            self._line = b""

    def end(self) -> None:
        """Take the last line, which may have no end."""
        if self._line:
            self._tell(self._line)
            self._line = b""

    def _tell(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace").rstrip("\r")
        self._last.append(text if len(text) <= _LINE else f"{text[: _LINE - 3]}...")
        sys.stderr.write(f"{text[:4096]}\n")

    @property
    def tail(self) -> str:
        """The last lines."""
        return "\n".join(self._last)

    @property
    def summary(self) -> str:
        """The last lines in one, for a reason; empty if nothing was printed."""
        lines = [
            line.strip() for line in self._last if line.strip("^~ \t")
        ]  # marks in tracebacks do not count
        return " | ".join(lines[-_SUMMARY:])
