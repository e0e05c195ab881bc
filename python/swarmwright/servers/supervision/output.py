"""Output of started servers: the last lines in memory, all lines in a file of the run."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path

from swarmwright.common import untrusted
from swarmwright.servers.supervision.marked_output import MARK

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
