"""What a command prints: passed on to this process's log, the last of it kept, too much of it refused."""

import os
import sys
import time
from collections import deque

from swarmwright.common.formatting import counted

LINES, _LINE = 20, 400
"""Lines that are kept of the end, and characters of each."""
_LOGGED_CHARACTERS = 4096
"""Characters of a line that are logged."""
_LOGGED_LINES, _LOGGED_S = 10_000, 60.0
"""Lines that are logged in so many seconds. Each is marked and read on its way into the log, which takes
longer than to print it; and meanwhile no limit of the process is looked after."""
_CHUNK_BYTES = 1 << 16
"""Read at a time."""
_SUMMARY_LINES = 3
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
        self._logged, self._omitted = 0, 0
        self._logs_since = time.monotonic()
        self.all = bytearray() if keep else None

    @property
    def is_too_much(self) -> bool:
        """Whether the process has printed more than it may."""
        return self._count > self._most

    def read(self, descriptor: int) -> bool:
        """Take what can be read; return False at the end."""
        data = os.read(descriptor, _CHUNK_BYTES)
        self.take(data)
        return bool(data)

    def take(self, data: bytes) -> None:
        """Take a piece of the output."""
        if self.is_too_much:
            return
        self._count += len(data)
        if self.all is not None:
            self.all += data
        lines, end, self._line = (self._line + data).rpartition(b"\n")
        if end:
            self._tell(lines)
        if len(self._line) > _CHUNK_BYTES:
            self._tell(self._line)
            self._line = b""

    def end(self) -> None:
        """Take the last line, which may have no end."""
        if self._line:
            self._tell(self._line)
            self._line = b""
        self._tell_omitted()

    def _tell(self, data: bytes) -> None:
        """Log lines, and keep the last of them: all at once, as a program may print millions."""
        now = time.monotonic()
        if now - self._logs_since >= _LOGGED_S:
            self._tell_omitted()
            self._logged, self._logs_since = 0, now
        lines = data.decode("utf-8", "replace").replace("\r\n", "\n").removesuffix("\r").split("\n")
        for line in lines[-LINES:]:
            self._last.append(line if len(line) <= _LINE else f"{line[: _LINE - 3]}...")
        logged = lines[: _LOGGED_LINES - self._logged]
        self._logged += len(logged)
        self._omitted += len(lines) - len(logged)
        if logged:
            sys.stderr.write("".join(f"{line[:_LOGGED_CHARACTERS]}\n" for line in logged))

    def _tell_omitted(self) -> None:
        """Log how many lines are left out, and the last of them."""
        if self._omitted:
            last = list(self._last)[-self._omitted :]
            if len(last) < self._omitted:
                count = counted(self._omitted - len(last), "line")
                last.insert(0, f"[{count} left out: more than {_LOGGED_LINES} in {_LOGGED_S:g} s]")
            sys.stderr.write("".join(f"{line}\n" for line in last))
            self._omitted = 0

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
        return " | ".join(lines[-_SUMMARY_LINES:])
