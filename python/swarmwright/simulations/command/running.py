"""A process of a command from its start to its end, within its limits."""

import os
import select
import signal
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright.simulations.command.failure import CommandFailure, ProcessEnded
from swarmwright.simulations.command.folders import size_of
from swarmwright.simulations.command.output import Printed
from swarmwright.simulations.command.process import Ended, Processes

_SIZE_CHECK_S = 0.25
"""Seconds between two looks at the size of the work folder, at least."""
MEGABYTE = 1_000_000


@dataclass(frozen=True)
class Limits:
    """What an episode may use."""

    timeout: float
    """Seconds."""
    output: float
    """Megabytes."""
    disk: float
    """Megabytes."""
    children: str = "fail"
    """Whether processes that are left fail it."""

    @property
    def most_output(self) -> int:
        """Bytes that may be printed."""
        return int(self.output * MEGABYTE)

    @property
    def largest(self) -> int:
        """Bytes of a file."""
        return int(self.disk * MEGABYTE)


class Watch:
    """Looks after the limits of a process while it runs."""

    def __init__(self, folder: Path, limits: Limits, processes: Processes) -> None:
        self._folder, self._limits, self._processes = folder, limits, processes
        self._looked, self._pause = time.monotonic(), _SIZE_CHECK_S
        self.deadline = time.monotonic() + limits.timeout

    def begin_again(self) -> None:
        """Begin another episode."""
        self.deadline = time.monotonic() + self._limits.timeout

    @property
    def pause(self) -> float:
        """Seconds that may be waited."""
        return max(0.0, min(self.deadline - time.monotonic(), self._pause))

    def check(self, printed: Printed) -> None:
        """Raise CommandFailure when something is used up."""
        limits, now = self._limits, time.monotonic()
        if now >= self.deadline:
            raise CommandFailure(
                f"has not ended after {limits.timeout:g} s (simulation.timeout), and was ended"
            )
        if printed.is_too_much:
            raise CommandFailure(f"printed more than {limits.output:g} MB (simulation.output), and was ended")
        if now - self._looked >= self._pause:
            self._processes.check()
            self.check_disk()
            took = time.monotonic() - now
            self._looked, self._pause = now, max(_SIZE_CHECK_S, 20 * took)

    def check_disk(self) -> None:
        """Raise CommandFailure when the work folder is too large."""
        if size_of(self._folder) > self._limits.largest:
            raise CommandFailure(
                f"wrote more than {self._limits.disk:g} MB into its work folder (simulation.disk)"
            )


def run(
    processes: Processes,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    limits: Limits,
    printed: Printed,
) -> None:
    """Run a command to its end.

    Raises CommandFailure unless its exit status is 0 and nothing is left of it.
    """
    reading, writing = os.pipe()
    nothing = os.open(os.devnull, os.O_RDONLY)
    try:
        try:
            processes.start(command, folder, environment, limits.largest, (nothing, writing, writing))
        finally:
            os.close(writing)
            os.close(nothing)
        watch = Watch(folder, limits, processes)
        ended = _attended(processes, reading, printed, watch)
        check_end(ended, limits)
        watch.check_disk()
    finally:
        printed.end()
        os.close(reading)


def _attended(processes: Processes, reading: int, printed: Printed, watch: Watch) -> Ended:
    """Read the output until the process has ended; kill it when it uses too much or this is interrupted."""
    poll = select.poll()
    poll.register(reading, select.POLLIN)
    poll.register(processes.channel, select.POLLIN)
    ended: Ended | None = None
    try:
        while ended is None:
            for descriptor, _ in poll.poll(watch.pause * 1000 + 1):
                if descriptor != reading:
                    ended = processes.report()
                elif not printed.read(reading):
                    poll.unregister(reading)
            if ended is None:
                watch.check(printed)
    except BaseException:
        processes.kill()
        _drain(reading, printed)
        raise
    _drain(reading, printed)
    if printed.is_too_much:
        watch.check(printed)
    return ended


def _drain(reading: int, printed: Printed) -> None:
    """Read what is still in the pipe."""
    os.set_blocking(reading, False)
    with suppress(BlockingIOError):
        while not printed.is_too_much and printed.read(reading):
            pass


def check_end(ended: Ended, limits: Limits) -> None:
    """Raise ProcessEnded for what did not end well."""
    if ended.status < 0:
        name = signal.Signals(-ended.status).name
        why = f": a file of more than {limits.disk:g} MB (simulation.disk)" if name == "SIGXFSZ" else ""
        raise ProcessEnded(f"was ended by {name}{why}")
    if ended.status:
        raise ProcessEnded(f"ended with exit status {ended.status}")
    if ended.left and limits.children == "fail":
        names = ", ".join(ended.left)
        raise ProcessEnded(
            f"ended, but left processes behind, which were killed: {names}; have it wait for them, or set "
            "simulation.children: end"
        )
