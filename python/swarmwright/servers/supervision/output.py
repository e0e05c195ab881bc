"""What started servers print: the last of it in memory, all of it in a file of the run."""

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

MOST_KEPT_LINES = 1000
"""Lines that are kept: of those that wait for a file, and of a server that has ended."""
LONGEST_LINE_CHARACTERS = 4000
"""Characters of a line that are kept."""
MOST_LINES_PER_SECOND = 1000
"""Lines of one server that are kept in a second."""
LARGEST_FILE_BYTES = 5_000_000
"""Bytes of the file before it is put aside; one that was put aside is kept."""

Place = tuple[int, int, int | None, str | None]
"""First candidate and first episode of a request, its generation, and otherwise what it was sent for."""

_servers = logging.getLogger("swarmwright.servers")
_listeners: list[Callable[[str], None]] = []


@contextmanager
def listening_to_output(listener: Callable[[str], None]) -> Iterator[None]:
    """Within the block, `listener` gets every line that started servers print; it must not take long."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


class _File(RotatingFileHandler):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """A log that cannot be written neither ends the run nor is reported at each line."""


class Output:
    """Takes the lines of all servers of a run; of any thread."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque(maxlen=MOST_KEPT_LINES)
        self._file: _File | None = None
        self._lock = threading.Lock()
        self._second: dict[int, tuple[int, int]] = {}
        self.place: Callable[[int], Place | None] = lambda _request: None
        """What a request is about, where that is known."""

    def log_to(self, path: Path) -> None:
        """Write to a file, which is made with the first line; what came before is written, too."""
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

    def line(self, server: int, raw: bytes) -> str:
        """Take a line as it came from a server; return it without its mark."""
        place = ""
        if raw.startswith(MARK):
            mark, _, raw = raw[1:].partition(MARK)
            place = self._named(mark)
        text = raw.decode(errors="replace").rstrip("\r\n")[:LONGEST_LINE_CHARACTERS]
        self.say(server, text, place)
        return text

    def _named(self, mark: bytes) -> str:
        """What was computed, as `candidate generation:candidate`."""
        request, first, episode = mark.decode(errors="replace").split(" ")
        found = self.place(int(request))
        if found is None:
            return ""
        return self.named(found, int(first), int(episode) if episode else None)

    def named(self, place: Place, first: int, episode: int | None) -> str:
        """Return what was computed, as `candidate generation:candidate`, or for what it was.

        Args:
            place: of the request.
            first: which of its candidates.
            episode: which of its episodes; None for all of them.
        """
        candidate, first_episode, generation, purpose = place
        number = candidate + first
        unnamed = purpose or f"candidate {number}"
        name = unnamed if generation is None else f"candidate {generation}:{number}"
        return name if episode is None else f"{name}, episode {first_episode + episode}"

    def say(self, server: int, text: str, place: str = "") -> None:
        """Take a line of text."""
        now = time.time()
        with self._lock:
            second, count = self._second.get(server, (0, 0))
            count = count + 1 if second == int(now) else 1
            dropped = self._second.get(server, (0, 0))[1] - MOST_LINES_PER_SECOND if count == 1 else 0
            self._second[server] = (int(now), count)
            stamp = datetime.fromtimestamp(now, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3]
            who = f"{stamp}Z server {server}"
            if dropped > 0:
                self._keep(f"{who}: {dropped} more lines in that second were left out")
            if count > MOST_LINES_PER_SECOND:
                return
            said = "".join(untrusted.lines(text))  # of one line; terminal control characters are dropped
            self._keep(f"{who}, {place}: {said}" if place else f"{who}: {said}")

    def _keep(self, line: str) -> None:
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
