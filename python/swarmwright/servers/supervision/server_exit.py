"""How a server's process ended, in words."""

import re
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.tracebacks import is_installed, shown

_EXTERNAL_SIGNALS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
"""Signals by which people, and systems that run out of memory, end processes."""

_FATAL = "Fatal Python error"
_THREAD = re.compile(r"(Current thread|Thread) 0x")
_LATE = re.compile(r"(.+?)((?:Current thread|Thread) 0x[0-9a-f]+.* \(most recent call first\):)")
"""The first line of a stack behind what was written without the end of a line, such as a question."""
_FRAME = re.compile(r'\s+File "(?P<file>[^"]+)", line (?P<line>\d+) in (?P<name>.+)')
_HOST = str(Path(__file__).parents[2] / "simulations" / "host.py")
_MOST_FRAMES = 100
"""Frames that Python's faulthandler writes of a stack, the innermost ones."""


def signal_name(number: int) -> str:
    """The name of a signal: 9 -> 'SIGKILL'."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@dataclass(frozen=True)
class ServerExit:
    """The end of a server's process.

    server: its id. status: exit status, negative for the signal that killed it. hung: why its supervisor
    ended it, None when it did not. lines: what it wrote last, without the stack. stack: Python's, of the
    thread that matters, empty where none was written.
    """

    server: int
    pid: int
    status: int
    hung: str | None
    lines: tuple[str, ...]
    stack: tuple[str, ...]

    @property
    def outside(self) -> bool:
        """Whether it was ended from outside, by a user or the system."""
        return self.hung is None and -self.status in _EXTERNAL_SIGNALS

    @property
    def how(self) -> str:
        """How it ended: `was ended by SIGSEGV in step (gather.py:12)`."""
        if self.hung is not None:
            return f"{self.hung}{self.where} and was ended"
        if self.status < 0:
            return f"was killed by {signal_name(-self.status)}{self.where}"
        return f"ended with status {self.status}{self.where}"

    @property
    def where(self) -> str:
        """In which function and line of the user's code: ` in step (gather.py:12)`; empty when unknown."""
        frames = [match for line in self.stack if (match := _FRAME.fullmatch(line))]
        mine = [frame for frame in frames if not is_installed(frame["file"])]
        if mine:
            return f" in {mine[0]['name']} ({shown(mine[0]['file'])}:{mine[0]['line']})"
        if len(frames) < _MOST_FRAMES:  # what only waits, or computes for something unknown, explains nothing
            return ""
        last = frames[0]
        return (
            f" in a recursion of more than {_MOST_FRAMES} calls, in {last['name']} "
            f"({shown(last['file'])}:{last['line']}), which the simulation's code began"
        )

    @property
    def words(self) -> str:
        """What it wrote last, and Python's stack; empty when there is nothing."""
        return "\n".join((*self.lines, *self.stack))

    @property
    def report(self) -> str:
        """How it ended and what it wrote last."""
        words = self.words
        return f"simulation server {self.server} {self.how}" + (f":\n{words}" if words else "")


def _parts(line: str) -> Sequence[str]:
    """Return what was written, and the first line of a stack behind it, where there are both."""
    match = _LATE.fullmatch(line)
    return (line,) if match is None else match.groups()


def split(lines: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Divide what a process wrote last into its own lines and the stack that Python's faulthandler wrote."""
    lines = [part for line in lines for part in _parts(line)]
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
    # The one that was in the simulation's code, or else the one that crashed.
    in_code = [stack for stack in stacks if any(f'"{_HOST}"' in line for line in stack)]
    current = [stack for stack in stacks if stack[0].startswith("Current")]
    chosen = (in_code or current or stacks or [[]])[0]
    return tuple(lines[:first]), (*head, *chosen)
