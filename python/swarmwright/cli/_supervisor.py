"""Starts simulation servers in processes of their own, hears what happens to them, and leaves none behind."""

import json
import os
import queue
import shutil
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Self

LAST_WORDS = 20
"""Lines of a dead server's standard error that are shown."""

GRACE = 5.0
"""Seconds that servers have to say good-bye before they are killed."""


@dataclass(frozen=True)
class Event:
    """Something that a server reported: `ready`, `busy`, `warning`, `failure`, `lost` or `error`."""

    server: int
    pid: int
    report: Mapping[str, Any]


@dataclass(frozen=True)
class Ended:
    """A server's process has ended without being asked to.

    status: exit status, negative for the signal that killed it. last_words: what it wrote to standard error.
    """

    server: int
    pid: int
    status: int
    last_words: str


@dataclass
class _Child:
    server: int
    process: subprocess.Popen[str]
    events: IO[str]
    words: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_WORDS))
    threads: list[threading.Thread] = field(default_factory=list)


class Supervisor:
    """Processes that each run `_engine.serve`; a context manager that stops them all.

    settings: one mapping of `_engine.serve`'s arguments per server, with its `id`; a simulation in Python
    by its class.
    """

    def __init__(self, settings: Sequence[Mapping[str, Any]]) -> None:
        self._settings = settings
        self._children: list[_Child] = []
        self._news: queue.SimpleQueue[Event | Ended] = queue.SimpleQueue()
        self._stopping = False

    def __enter__(self) -> Self:
        try:
            for settings in self._settings:
                self._children.append(self._start(settings))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def news(self) -> Iterator[Event | Ended]:
        """What happens, as it happens; ends when no server is left."""
        alive = len(self._children)
        while alive:
            # A time-out, because a wait without one cannot be interrupted on every system.
            try:
                item = self._news.get(timeout=1.0)
            except queue.Empty:
                continue
            alive -= isinstance(item, Ended)
            yield item

    def stop(self) -> None:
        """End all servers: ask, wait, then kill."""
        self._stopping = True
        for child in self._children:
            if child.process.stdin and not child.process.stdin.closed:
                child.process.stdin.close()
        for child in self._children:
            try:
                child.process.wait(GRACE)
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
            for thread in child.threads:
                thread.join(GRACE)

    def _start(self, settings: Mapping[str, Any]) -> _Child:
        columns = shutil.get_terminal_size().columns
        reading, writing = os.pipe()
        try:
            process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "swarmwright._server_process",
                    str(writing),
                    json.dumps(settings),
                ],
                stdin=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=[writing],
                env={**os.environ, "COLUMNS": str(columns)},  # for what it draws when asked to
                process_group=0,  # Ctrl-C reaches the parent alone, which then ends them in order
                text=True,
                errors="replace",
            )
        except BaseException:
            os.close(reading)
            raise
        finally:
            os.close(writing)
        child = _Child(int(settings["id"]), process, os.fdopen(reading, encoding="utf-8", errors="replace"))
        words = threading.Thread(target=self._listen, args=(child,), daemon=True)
        events = threading.Thread(target=self._watch, args=(child, words), daemon=True)
        child.threads = [words, events]
        words.start()
        events.start()
        return child

    @staticmethod
    def _listen(child: _Child) -> None:
        assert child.process.stderr is not None
        with child.process.stderr as stream:
            child.words.extend(line.rstrip("\n") for line in stream)

    def _watch(self, child: _Child, words: threading.Thread) -> None:
        with child.events as stream:
            for line in stream:
                try:
                    report = json.loads(line)
                except ValueError:
                    continue  # cut off in the middle by the end of the process
                self._news.put(Event(child.server, child.process.pid, report))
        status = child.process.wait()
        words.join(GRACE)
        if not self._stopping:
            self._news.put(Ended(child.server, child.process.pid, status, "\n".join(child.words)))
