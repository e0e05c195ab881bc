"""Output of started servers: the last lines in memory, all lines in a file of the run."""

import io
import logging
import os
import re
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from tempfile import TemporaryFile
from typing import Self

from swarmwright.common import untrusted

_NUMBERS = struct.Struct("<6Q")
_ALL = 2**64 - 1


@dataclass(frozen=True)
class Sample:
    """A snapshot of a server's work; see `_engine.serve`."""

    request: int = 0
    first: int = 0
    """Index of the first candidate in the request."""
    candidates: int = 0
    """Number of candidates; 0 outside a request."""
    episode: int | None = None
    """Index of the episode in the request; None for all of them. Without candidates: None when idle, else
    episodes are being stepped, whose numbers only the tool knows."""
    ended: int = 0
    """Evaluations finished since the process started."""
    beats: int = 0
    """Signs of life."""

    @classmethod
    def read(cls, file: int) -> Self:
        """Read a sample from an open file."""
        data = os.pread(file, _NUMBERS.size, 0)
        if len(data) < _NUMBERS.size:
            return cls()
        request, first, candidates, episode, ended, beats = _NUMBERS.unpack(data)
        return cls(request, first, candidates, None if episode == _ALL else episode, ended, beats)

    @property
    def is_at_work(self) -> bool:
        """Whether the server was computing."""
        return self.candidates > 0 or self.episode is not None

    @property
    def is_stepped(self) -> bool:
        """Whether episodes were being stepped."""
        return self.is_at_work and not self.candidates

    def continues(self, before: Self) -> bool:
        """Whether the server still works on the request or stepped episodes of an earlier sample."""
        if before.candidates:
            return self.candidates > 0 and self.request == before.request
        return before.is_stepped and self.is_stepped and self.ended == before.ended

    @property
    def position(self) -> tuple[int, int, int, int | None] | None:
        """The current work, as `_engine.Supervision.ended` takes it, or None."""
        return (self.request, self.first, self.candidates, self.episode) if self.candidates else None


class Progress:
    """The shared memory of one process."""

    def __init__(self) -> None:
        if hasattr(os, "memfd_create"):
            self.file = os.memfd_create("swarmwright")
        else:
            with TemporaryFile() as file:
                self.file = os.dup(file.fileno())

    def read(self) -> Sample:
        """Return the current content."""
        return Sample.read(self.file)

    def close(self) -> None:
        """Release the memory."""
        os.close(self.file)


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


MAX_KEPT_LINES = 1000
"""Upper limit of lines kept in memory, waiting for a file or of an ended server."""
LONGEST_LINE_CHARACTERS = 4000
"""Characters kept of a line."""
MAX_LINES_PER_SECOND = 1000
"""Lines kept per server and second."""
LARGEST_FILE_BYTES = 5_000_000
"""Size at which the file is rotated; one old file is kept."""

Origin = tuple[int, int, int | None, str | None]
"""First candidate, first episode and generation of a request, or else its purpose."""

_servers = logging.getLogger("swarmwright.servers")
_listeners: list[Callable[[str], None]] = []


@contextmanager
def listening_to_output(listener: Callable[[str], None]) -> Iterator[None]:
    """Call `listener` with every output line of started servers within the block; it must be quick."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


class _File(RotatingFileHandler):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Ignore errors of writing the log, which must neither end the run nor repeat per line."""


class Output:
    """Collector of the output of all servers of a run, for use from any thread."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque(maxlen=MAX_KEPT_LINES)
        self._file: _File | None = None
        self._lock = threading.Lock()
        self._second: dict[int, tuple[int, int]] = {}
        self.find_origin: Callable[[int], Origin | None] = lambda _request: None
        """Returns the origin of a request, if known."""

    def log_to(self, path: Path) -> None:
        """Write to a file, created with the first line, including earlier lines."""
        with self._lock:
            self._close()
            self._file = _File(path, maxBytes=LARGEST_FILE_BYTES, backupCount=1, encoding="utf-8", delay=True)
            while self._waiting:
                self._write(self._waiting.popleft())

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def record_raw(self, server: int, raw: bytes) -> str:
        """Record a raw line of a server; return it without its mark."""
        work = ""
        if raw.startswith(MARK):
            mark, _, raw = raw[1:].partition(MARK)
            work = self._describe_mark(mark)
        text = raw.decode(errors="replace").rstrip("\r\n")[:LONGEST_LINE_CHARACTERS]
        self.record(server, text, work)
        return text

    def _describe_mark(self, mark: bytes) -> str:
        """Describe the work of a mark as `candidate generation:candidate`."""
        request, first, episode = mark.decode(errors="replace").split(" ")
        origin = self.find_origin(int(request))
        if origin is None:
            return ""
        return self.describe(origin, int(first), int(episode) if episode else None)

    def describe(self, origin: Origin, first: int, episode: int | None) -> str:
        """Describe work as `candidate generation:candidate`, or by its purpose.

        Args:
            origin: origin of the request.
            first: index of the candidate in the request.
            episode: index of the episode in the request; None for all of them.
        """
        candidate, first_episode, generation, purpose = origin
        number = candidate + first
        unnamed = purpose or f"candidate {number}"
        name = unnamed if generation is None else f"candidate {generation}:{number}"
        return name if episode is None else f"{name}, episode {first_episode + episode}"

    def record(self, server: int, text: str, work: str = "") -> None:
        """Record a line of text."""
        now = time.time()
        with self._lock:
            second, count = self._second.get(server, (0, 0))
            count = count + 1 if second == int(now) else 1
            dropped = self._second.get(server, (0, 0))[1] - MAX_LINES_PER_SECOND if count == 1 else 0
            self._second[server] = (int(now), count)
            stamp = datetime.fromtimestamp(now, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3]
            label = f"{stamp}Z server {server}"
            if dropped > 0:
                self._publish(f"{label}: {dropped} more lines in this second were dropped")
            if count > MAX_LINES_PER_SECOND:
                return
            line = "".join(untrusted.escape_lines(text))  # drops terminal control characters
            self._publish(f"{label}, {work}: {line}" if work else f"{label}: {line}")

    def _publish(self, line: str) -> None:
        if self._file is None:
            self._waiting.append(line)
        else:
            self._write(line)
        for listener in tuple(_listeners):
            listener(line)
        _servers.info("%s", line)

    def _write(self, line: str) -> None:
        if self._file is not None:
            self._file.handle(logging.makeLogRecord({"msg": line}))
