"""The end of a server's process, with its description."""

import re
import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmwright.common.tracebacks import is_installed, shorten_path

_EXTERNAL_SIGNALS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
"""Signals by which users and the system end processes."""

_FATAL = "Fatal Python error"
_THREAD = re.compile(r"(Current thread|Thread) 0x")
_LATE_STACK = re.compile(r"(.+?)((?:Current thread|Thread) 0x[0-9a-f]+.* \(most recent call first\):)")
"""The first line of a stack behind output without a line break, such as a prompt."""
_FRAME = re.compile(r'\s+File "(?P<file>[^"]+)", line (?P<line>\d+) in (?P<name>.+)')
_HOST = str(Path(__file__).parents[2] / "simulations" / "host.py")
_MOST_FRAMES = 100
"""Number of innermost frames that Python's faulthandler writes."""


def signal_name(number: int) -> str:
    """Return the name of a signal: 9 -> 'SIGKILL'."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@dataclass(frozen=True)
class ServerExit:
    """The end of a server's process."""

    server: int
    """Id of the server."""
    pid: int
    status: int
    """Exit status, negative for the signal that killed it."""
    hung: str | None
    """Why its supervisor ended it, if it did."""
    lines: tuple[str, ...]
    """Its last output, without the stack."""
    stack: tuple[str, ...]
    """Python's stack of the relevant thread, if any."""

    @property
    def is_external(self) -> bool:
        """Whether a user or the system ended it."""
        return self.hung is None and -self.status in _EXTERNAL_SIGNALS

    @property
    def description(self) -> str:
        """Description of the end: `was killed by SIGSEGV in step (gather.py:12)`."""
        if self.hung is not None:
            return f"{self.hung}{self.location} and was ended"
        if self.status < 0:
            return f"was killed by {signal_name(-self.status)}{self.location}"
        return f"ended with status {self.status}{self.location}"

    @property
    def location(self) -> str:
        """Function and line of the user's code: ` in step (gather.py:12)`; empty if unknown."""
        frames = [match for line in self.stack if (match := _FRAME.fullmatch(line))]
        mine = [frame for frame in frames if not is_installed(frame["file"])]
        if mine:
            return f" in {mine[0]['name']} ({shorten_path(mine[0]['file'])}:{mine[0]['line']})"
        if len(frames) < _MOST_FRAMES:  # library frames alone explain nothing
            return ""
        last = frames[0]
        return (
            f" in a recursion of more than {_MOST_FRAMES} calls, started by the simulation's code, in "
            f"{last['name']} ({shorten_path(last['file'])}:{last['line']})"
        )

    @property
    def output_text(self) -> str:
        """Its last output and Python's stack; may be empty."""
        return "\n".join((*self.lines, *self.stack))

    @property
    def report(self) -> str:
        """Description of the end, followed by its last output."""
        words = self.output_text
        return f"simulation server {self.server} {self.description}" + (f":\n{words}" if words else "")


def _split_late_stack(line: str) -> Sequence[str]:
    """Separate output from the first line of a stack behind it."""
    match = _LATE_STACK.fullmatch(line)
    return (line,) if match is None else match.groups()


def split_output(lines: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split the last output of a process into its own lines and the stack of Python's faulthandler."""
    lines = [part for line in lines for part in _split_late_stack(line)]
    begins = [index for index, line in enumerate(lines) if line.startswith(_FATAL) or _THREAD.match(line)]
    if not begins:
        return tuple(lines), ()
    first = begins[0]
    threads: list[list[str]] = [[]]
    for line in lines[first:]:
        if _THREAD.match(line):
            threads.append([line])
        elif line.startswith(_FATAL) or (_FRAME.fullmatch(line) and threads[-1]):
            threads[-1].append(line)
    head, *stacks = threads
    # Prefer the thread in the simulation's code, then the crashed one.
    in_code = [stack for stack in stacks if any(f'"{_HOST}"' in line for line in stack)]
    current = [stack for stack in stacks if stack[0].startswith("Current")]
    stack = (in_code or current or stacks or [[]])[0]
    return tuple(lines[:first]), (*head, *stack)


@dataclass(frozen=True)
class ServerEvent:
    """A report of a server: `ready`, `busy`, `warning`, `failure`, `lost` or `error`."""

    server: int
    pid: int
    report: Mapping[str, Any]


@dataclass(frozen=True)
class ServerEnd:
    """A server's process has ended unexpectedly.

    pause: seconds until its restart; None if it is not restarted.
    """

    server_exit: ServerExit
    pause: float | None


@dataclass(frozen=True)
class ServerRestart:
    """A server was restarted."""

    server: int
    pid: int


News = ServerEvent | ServerEnd | ServerRestart
