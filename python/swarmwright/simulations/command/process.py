"""Processes of a command, started and ended by a keeper of their own.

A process of a command from its start to its end, within its limits.

What a command prints: passed on to this process's log, the last of it kept, too much of it refused.
"""

import contextlib
import errno
import json
import os
import re
import secrets
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
import weakref
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmwright.common import processes
from swarmwright.common.formatting import format_count
from swarmwright.common.suggestions import did_you_mean, nearest, similar
from swarmwright.simulations.command.work_files import size_of


class CommandFailure(Exception):  # noqa: N818 - it is the reason of a failed evaluation
    """An episode has failed; the message is a line, without the program's output."""


class ProcessEnded(CommandFailure):
    """The process has ended by itself, and not well."""


class ReportedFailure(CommandFailure):
    """The program has answered that the episode failed; `reason` is what it says."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"reports: {reason}")
        self.reason = reason


KEEPER = Path(__file__).with_name("keeper.py")
_LARGEST_MESSAGE_BYTES = 1 << 20
"""Of the keeper's answer."""
_ANSWER_S = 30.0
"""Seconds in which the keeper answers, when the machine is slow."""
_LOOK_S = 0.25
"""Seconds of waiting for an answer between two looks whether the keeper was stopped."""
_NO_KEEPER = "the process that starts commands has ended, and all commands with it"
_MARK = "SWARMWRIGHT_COMMAND"
"""Variable of the environment by which processes are found whose keeper was killed."""
_LOOKS = 3
"""How often in a row nothing is to be found of what a killed keeper has left."""
_INTERPRETER = re.compile(
    r"python[\d.]*|pypy[\d.]*|sh|bash|dash|zsh|Rscript|perl|ruby|node|lua[\d.]*|julia|java"
)
_FLAGS = frozenset({"-u", "-O", "-OO", "-B", "-E", "-I", "-s", "-S", "-x", "-jar", "--vanilla"})
"""Options of interpreters behind which the script may stand."""
_SIMILAR_SPELLING = 0.85
"""Similarity of spelling, from 0 to 1, from which on one of the programs on the PATH is suggested."""
_SCRIPTS = frozenset({".py", ".sh", ".R", ".r", ".pl", ".rb", ".js", ".mjs", ".lua", ".jl", ".jar"})
GRACE_S = 2.0
"""Seconds between asking a process to end and killing it."""


@dataclass(frozen=True)
class Ended:
    """How a process ended."""

    status: int
    """Exit status, or minus the number of a signal."""
    left: tuple[str, ...]
    """Names of processes that it had started, which still ran and were killed."""


class Processes:
    """Starts one process at a time; everything below it ends with it, and with this process."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._keeper = subprocess.Popen(
                [sys.executable, "-I", "-S", str(KEEPER), str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # signals for this process's group are not for it
            )
        self.channel = ours
        self._mark = secrets.token_hex(16)
        self._end = weakref.finalize(self, _end, ours, self._keeper, self._mark)

    @property
    def is_alive(self) -> bool:
        """Whether the keeper runs."""
        return self._keeper.poll() is None

    def start(
        self,
        command: Sequence[str],
        folder: Path,
        environment: Mapping[str, str],
        largest: int,
        streams: tuple[int, int, int],
    ) -> None:
        """Start a process.

        Args:
            command: its words.
            folder: its working folder.
            environment: variables beside those of this process.
            largest: bytes of a file that it may write.
            streams: descriptors of its standard input, output and error.

        Raises CommandFailure when it cannot be started.
        """
        what = {
            "command": list(command),
            "folder": str(folder),
            "environment": {**processes.hash_seed_variables(), **environment, _MARK: self._mark},
            "largest": largest,
        }
        try:
            packet = json.dumps({"start": what}).encode()
            socket.send_fds(self.channel, [packet], list(streams))
            answer = self._answer()
        except OSError as error:
            raise CommandFailure(f"cannot be started: {error.strerror or error}") from error
        if "refused" in answer:
            raise CommandFailure(_refusal(command[0], *answer["refused"]))

    def report(self) -> Ended:
        """Return how the process ended, when `channel` can be read."""
        answer = self._answer()
        return Ended(int(answer["ended"]), tuple(map(str, answer["left"])))

    def kill(self, patience: float = GRACE_S) -> Ended:
        """End the process and everything below it; first ask, and wait for so many seconds."""
        with contextlib.suppress(OSError):
            self.channel.send(json.dumps({"kill": patience}).encode())
        try:
            return self.report()
        except (OSError, CommandFailure):
            return Ended(-9, ())

    def check(self) -> None:
        """Raise CommandFailure where the keeper was stopped, as by a command that stops its parent."""
        stopped = os.WSTOPPED | os.WNOHANG | os.WNOWAIT
        if self._end.alive and os.waitid(os.P_PID, self._keeper.pid, stopped) is not None:
            self._keeper.kill()
            self.close()
            raise CommandFailure(
                "the process that starts commands was stopped by a signal, perhaps the command's own (kill "
                "-STOP $PPID), so all commands were ended"
            )

    def _answer(self) -> dict[str, Any]:
        if not self._end.alive:
            raise CommandFailure(_NO_KEEPER)
        readable, until = False, time.monotonic() + _ANSWER_S
        while not readable and time.monotonic() < until:
            readable = bool(select.select([self.channel], [], [], _LOOK_S)[0])
            if not readable:
                self.check()
        data = self.channel.recv(_LARGEST_MESSAGE_BYTES) if readable else b""
        if not data:
            self.close()
            raise CommandFailure(_NO_KEEPER)
        answer: dict[str, Any] = json.loads(data)
        return answer

    def close(self) -> None:
        """End everything."""
        self._end()


def _end(channel: socket.socket, keeper: "subprocess.Popen[bytes]", mark: str) -> None:
    channel.close()
    try:
        keeper.wait(15.0)
    except subprocess.TimeoutExpired:
        keeper.kill()
        keeper.wait()
    if keeper.returncode != 0:
        _kill_marked(mark)


def _kill_marked(mark: str) -> None:
    """Kill what a keeper has left that was itself killed.

    A process that has just been started may be missed: it was not there yet when `/proc` was listed, or
    it was loading its program and had no environment. So this is done until nothing is found three times.
    """
    wanted = f"{_MARK}={mark}".encode()
    until, quiet = time.monotonic() + _ANSWER_S, 0
    while quiet < _LOOKS and time.monotonic() < until:
        found = False
        for place in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if wanted in place.read_bytes().split(b"\0"):
                    found = True
                    os.kill(int(place.parent.name), signal.SIGKILL)
        quiet = 0 if found else quiet + 1
        time.sleep(0.01)


def _refusal(program: str, number: int, text: str) -> str:
    """Return why a program was not started, and what can be done."""
    if number == errno.ENOENT and os.sep not in program:
        return f"there is no program {program!r} on the PATH, and no such file beside the experiment file"
    if number == errno.ENOENT:
        if Path(program).exists():
            return f"{program}: the program that its first line (#!) names does not exist"
        return f"{program}: there is no such file"
    if number == errno.EACCES:
        if Path(program).is_dir():
            return f"{program}: is a folder, not a program"
        how = f"chmod +x {program}"
        if program.endswith(".py"):
            how = f"write command: python3 {Path(program).name} .., or {how}"
        return f"{program}: is not executable; {how}"
    if number == errno.ENOEXEC:
        return f"{program}: is not a program: its first line must be such as #!/bin/sh"
    return f"{program}: cannot be started: {text}"


def missing_program(words: Sequence[str], folder: Path) -> str | None:
    """Return why a command's program cannot be started, as far as that is known before; None where it can.

    folder: that its path is relative to.
    """
    program = resolved_word(words[0], folder)
    if "{" in program or shutil.which(program):
        return None
    there = Path(program).exists()
    if os.sep not in program and not there:
        return f"{_refusal(program, errno.ENOENT, '')}{_program_hint(program, folder)}"
    return _refusal(program, errno.EACCES if there else errno.ENOENT, "")


def _program_hint(program: str, folder: Path) -> str:
    """Return which file of the folder was meant, or else which program on the PATH; "" where none is near."""
    beside: dict[str, str] = {}
    for name in _files_of(folder):
        path = folder / name
        if path.suffix in _SCRIPTS or os.access(path, os.X_OK):
            beside[path.stem], beside[name] = name, name
    meant = nearest(program, beside)
    if meant is not None:
        return f"; did you mean '{beside[meant]}', which is there?"
    near = similar(program, _programs(), _SIMILAR_SPELLING)
    return "" if near is None else f"; did you mean '{near}'?"


def _files_of(folder: Path) -> list[str]:
    """Return the names of the files in a folder, none of one that cannot be read."""
    with contextlib.suppress(OSError):
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_file())
    return []


def missing_script(words: Sequence[str], folder: Path, copied: Iterable[str]) -> str | None:
    """Return why an interpreter does not find the script that a command names; None where that is not known.

    Args:
        words: of the command.
        folder: that its paths are relative to.
        copied: names of files in the work folder.
    """
    if not _INTERPRETER.fullmatch(Path(words[0]).name):
        return None
    script = next((word for word in words[1:] if word not in _FLAGS), "")
    if Path(script).suffix not in _SCRIPTS or script.startswith("-") or "{" in script:
        return None  # a name without a suffix may be a module or a class, or gets one
    if Path(words[0]).name == "java" and "-jar" not in words[1 : words.index(script)]:
        return None
    if os.path.normpath(script) in map(os.path.normpath, copied):
        return None
    if (folder / script).exists() or shutil.which(script):
        return None
    place = (folder / script).parent
    suggestion = did_you_mean(Path(script).name, _files_of(place))
    return (
        f"{script}: there is no such file beside the experiment file{suggestion}; the command runs in a work "
        "folder of its own, into which simulation.files copies others"
    )


def _programs() -> list[str]:
    """Return the names of programs on the PATH."""
    names: set[str] = set()
    for place in os.get_exec_path():
        with contextlib.suppress(OSError):
            names.update(entry.name for entry in os.scandir(place))
    return sorted(names)


def resolved_word(word: str, folder: Path) -> str:
    """Return a command's word as the process gets it: the path of the file that it names, or itself."""
    if word.startswith("-") or not word:
        return word
    path = folder / word
    try:
        if path.is_file() and not (os.sep not in word and path.suffix == "" and shutil.which(word)):
            return str(path.resolve() if not path.is_symlink() else path.absolute())
    except OSError:  # too long for a name
        pass
    return word


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
                count = format_count(self._omitted - len(last), "line")
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
