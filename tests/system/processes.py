"""A program beside the test, whose lines are read as they come."""

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from tests.conftest import PROGRAM, environment

Event = dict[str, Any]

BUSY = 3
"""By how much waiting may exceed its bound, which is that of a quiet machine."""


class Program:
    """`swarmwright ARGUMENTS`; its lines are collected by threads, so that it never waits for its reader."""

    def __init__(
        self,
        *arguments: str | Path | int,
        cwd: Path,
        env: Mapping[str, str] | None = None,
        program: Sequence[str] = PROGRAM,
    ) -> None:
        self.process = subprocess.Popen(
            [*program, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env=environment(env),
            cwd=cwd,
        )
        self.lines: list[str] = []
        self.errors: list[str] = []
        self._news = threading.Condition()
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self._threads = [
            threading.Thread(target=self._collect, args=pair, daemon=True)
            for pair in ((self.process.stdout, self.lines), (self.process.stderr, self.errors))
        ]
        for thread in self._threads:
            thread.start()

    def _collect(self, stream: IO[str], lines: list[str]) -> None:
        with stream:
            for line in stream:
                with self._news:
                    lines.append(line.rstrip("\n"))
                    self._news.notify_all()

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def stderr(self) -> str:
        with self._news:
            return "\n".join(self.errors)

    def events(self, kind: str | None = None, server: int | None = None) -> list[Event]:
        """What came so far, of `--json`."""
        with self._news:
            lines = list(self.lines)
        found = [json.loads(line) for line in lines if line.startswith("{")]
        return [
            event
            for event in found
            if kind in {None, event.get("event")} and server in {None, event.get("server")}
        ]

    def until(self, reached: Callable[["Program"], bool], what: str, seconds: float = 20) -> None:
        """Wait until `reached`; fail, with all that came, when it is not or the program ends before."""
        deadline = time.monotonic() + BUSY * seconds
        while not reached(self):
            ended = self.process.poll() is not None
            if ended:
                self._join()
                if reached(self):
                    return
            said = "\n".join([*self.lines[-20:], *self.errors[-20:]])
            assert not ended, f"ended with {self.process.returncode} before {what}:\n{said}"
            assert time.monotonic() < deadline, f"no {what} within {BUSY * seconds} s:\n{said}"
            with self._news:
                self._news.wait(0.05)

    def until_event(
        self, kind: str, count: int = 1, *, server: int | None = None, seconds: float = 20
    ) -> Event:
        """Wait for the `count`th event of a kind and return it."""
        self.until(lambda _: len(self.events(kind, server)) >= count, f"event {kind}", seconds)
        return self.events(kind, server)[count - 1]

    def until_error(self, text: str, seconds: float = 20) -> str:
        """Wait for a line with `text` on standard error and return it."""
        self.until(lambda _: text in self.stderr, f"{text!r} on standard error", seconds)
        return next(line for line in self.stderr.splitlines() if text in line)

    def wait(self, seconds: float = 30) -> int:
        """Exit status, once it has ended."""
        try:
            status = self.process.wait(BUSY * seconds)
        except subprocess.TimeoutExpired:
            said = "\n".join([*self.lines[-20:], *self.errors[-20:]])
            raise AssertionError(f"did not end within {BUSY * seconds} s:\n{said}") from None
        self._join()
        assert "Traceback" not in self.stderr, self.stderr
        return status

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def stop(self) -> None:
        """Ask it to end, then see it off."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait(10)
        self._join()

    def _join(self) -> None:
        for thread in self._threads:
            thread.join(5)


class Servers(Program):
    """`swarmwright serve minisim` with `count` servers, ids from `first` on; ready once made."""

    def __init__(self, url: str, *options: str, cwd: Path, first: int = 1, count: int = 1) -> None:
        command: list[str | int] = [
            "serve",
            "minisim",
            "--broker",
            url,
            "--id",
            first,
            "--count",
            count,
            "--json",
        ]
        super().__init__(*command, *options, cwd=cwd)
        try:
            for server in range(first, first + count):
                self.until_event("ready", server=server)
        except BaseException:
            self.stop()
            raise
        self.pids = {event["server"]: int(event["pid"]) for event in self.events("ready")}

    def signal_server(self, server: int, number: signal.Signals) -> None:
        """Send a signal to the process of one server."""
        os.kill(self.pids[server], number)

    def warnings(self, server: int | None = None) -> list[str]:
        """What the servers complained of."""
        return [event["message"] for event in self.events("warning", server)]
