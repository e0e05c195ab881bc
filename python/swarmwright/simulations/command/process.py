"""Runs processes of a command within limits, through a keeper process that starts and ends them.

Their output is passed on to this process's log; the last lines are kept, and too much output is an error.
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
from swarmwright.simulations.command.work_files import measure_size


class CommandFailure(Exception):  # noqa: N818 - it is the reason of a failed evaluation
    """An episode has failed; the message is a single line, without the program's output."""


class ProcessEnded(CommandFailure):
    """The process has ended by itself with a failure."""


class ReportedFailure(CommandFailure):
    """The program has reported that the episode failed, with a `reason`."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"reports: {reason}")
        self.reason = reason


KEEPER = Path(__file__).with_name("keeper.py")
_LARGEST_MESSAGE_BYTES = 1 << 20
"""Largest size of the keeper's answer in bytes."""
_ANSWER_S = 30.0
"""Seconds to wait for the keeper's answer, for slow machines."""
_POLL_S = 0.25
"""Seconds between two checks whether the keeper was stopped, while waiting for an answer."""
_NO_KEEPER = "the process that starts commands has ended, and all commands with it"
_MARK = "SWARMWRIGHT_COMMAND"
"""Environment variable that identifies processes whose keeper was killed."""
_EMPTY_SCANS = 3
"""Consecutive scans without a process of a killed keeper after which none is assumed to be left."""
_INTERPRETER = re.compile(
    r"python[\d.]*|pypy[\d.]*|sh|bash|dash|zsh|Rscript|perl|ruby|node|lua[\d.]*|julia|java"
)
_FLAGS = frozenset({"-u", "-O", "-OO", "-B", "-E", "-I", "-s", "-S", "-x", "-jar", "--vanilla"})
"""Options of interpreters that may be followed by the script."""
_SIMILAR_SPELLING = 0.85
"""Smallest similarity, from 0 to 1, at which a program on the PATH is suggested."""
_SCRIPTS = frozenset({".py", ".sh", ".R", ".r", ".pl", ".rb", ".js", ".mjs", ".lua", ".jl", ".jar"})
GRACE_S = 2.0
"""Seconds between asking a process to end and killing it."""


@dataclass(frozen=True)
class ExitReport:
    """The end of a process."""

    status: int
    """Exit status, or minus the number of a signal."""
    leftover: tuple[str, ...]
    """Names of its descendants that still ran and were killed."""


class Processes:
    """Runs one process at a time; its descendants end with it, and with this process."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._keeper = subprocess.Popen(
                [sys.executable, "-I", "-S", str(KEEPER), str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # not to receive signals for this process's group
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
            environment: variables in addition to those of this process.
            largest: most bytes of a file that it writes.
            streams: descriptors of its standard input, output and error.

        Raises CommandFailure if it cannot be started.
        """
        request = {
            "command": list(command),
            "folder": str(folder),
            "environment": {**processes.hash_seed_variables(), **environment, _MARK: self._mark},
            "largest": largest,
        }
        try:
            packet = json.dumps({"start": request}).encode()
            socket.send_fds(self.channel, [packet], list(streams))
            answer = self._answer()
        except OSError as error:
            raise CommandFailure(f"cannot be started: {error.strerror or error}") from error
        if "refused" in answer:
            raise CommandFailure(_explain_refusal(command[0], *answer["refused"]))

    def report(self) -> ExitReport:
        """Return how the process ended; called when `channel` is readable."""
        answer = self._answer()
        return ExitReport(int(answer["ended"]), tuple(map(str, answer["left"])))

    def kill(self, patience: float = GRACE_S) -> ExitReport:
        """Ask the process to end, wait for `patience` seconds, then kill it and its descendants."""
        with contextlib.suppress(OSError):
            self.channel.send(json.dumps({"kill": patience}).encode())
        try:
            return self.report()
        except (OSError, CommandFailure):
            return ExitReport(-9, ())

    def check(self) -> None:
        """Raise CommandFailure if the keeper was stopped, such as by a command that stops its parent."""
        stopped = os.WSTOPPED | os.WNOHANG | os.WNOWAIT
        if self._end.alive and os.waitid(os.P_PID, self._keeper.pid, stopped) is not None:
            self._keeper.kill()
            self.close()
            raise CommandFailure(
                "the process that starts commands was stopped by a signal, perhaps from the command (kill "
                "-STOP $PPID), so all commands were ended"
            )

    def _answer(self) -> dict[str, Any]:
        if not self._end.alive:
            raise CommandFailure(_NO_KEEPER)
        readable, until = False, time.monotonic() + _ANSWER_S
        while not readable and time.monotonic() < until:
            readable = bool(select.select([self.channel], [], [], _POLL_S)[0])
            if not readable:
                self.check()
        data = self.channel.recv(_LARGEST_MESSAGE_BYTES) if readable else b""
        if not data:
            self.close()
            raise CommandFailure(_NO_KEEPER)
        answer: dict[str, Any] = json.loads(data)
        return answer

    def close(self) -> None:
        """End all processes."""
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
    """Kill the processes of a keeper that was itself killed.

    A scan may miss a process that has just been started: it was not yet in `/proc`, or it was loading its
    program and had no environment. So the scan is repeated until it finds nothing three times.
    """
    marker = f"{_MARK}={mark}".encode()
    until, empty_scans = time.monotonic() + _ANSWER_S, 0
    while empty_scans < _EMPTY_SCANS and time.monotonic() < until:
        has_found = False
        for path in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if marker in path.read_bytes().split(b"\0"):
                    has_found = True
                    os.kill(int(path.parent.name), signal.SIGKILL)
        empty_scans = 0 if has_found else empty_scans + 1
        time.sleep(0.01)


def _explain_refusal(program: str, number: int, text: str) -> str:
    """Return why a program was not started, and a remedy."""
    if number == errno.ENOENT and os.sep not in program:
        return f"there is no program {program!r} on the PATH or beside the experiment file"
    if number == errno.ENOENT:
        if Path(program).exists():
            return f"{program}: the program named in its first line (#!) does not exist"
        return f"{program}: there is no such file"
    if number == errno.EACCES:
        if Path(program).is_dir():
            return f"{program}: is a folder, not a program"
        how = f"chmod +x {program}"
        if program.endswith(".py"):
            how = f"write command: python3 {Path(program).name} .., or {how}"
        return f"{program}: is not executable; {how}"
    if number == errno.ENOEXEC:
        return f"{program}: is not a program; its first line must be like #!/bin/sh"
    return f"{program}: cannot be started: {text}"


def explain_missing_program(words: Sequence[str], folder: Path) -> str | None:
    """Return why a command's program cannot be started, if that is known in advance, else None.

    folder: folder that its path is relative to.
    """
    program = resolve_word(words[0], folder)
    if "{" in program or shutil.which(program):
        return None
    exists = Path(program).exists()
    if os.sep not in program and not exists:
        return f"{_explain_refusal(program, errno.ENOENT, '')}{_suggest_program(program, folder)}"
    return _explain_refusal(program, errno.EACCES if exists else errno.ENOENT, "")


def _suggest_program(program: str, folder: Path) -> str:
    """Suggest a file in the folder, or else a program on the PATH; "" if none is similar."""
    files: dict[str, str] = {}
    for name in _files_of(folder):
        path = folder / name
        if path.suffix in _SCRIPTS or os.access(path, os.X_OK):
            files[path.stem], files[name] = name, name
    file = nearest(program, files)
    if file is not None:
        return f"; did you mean '{files[file]}'?"
    similar_program = similar(program, _programs(), _SIMILAR_SPELLING)
    return "" if similar_program is None else f"; did you mean '{similar_program}'?"


def _files_of(folder: Path) -> list[str]:
    """Return the names of the files in a folder; empty if it cannot be read."""
    with contextlib.suppress(OSError):
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_file())
    return []


def explain_missing_script(words: Sequence[str], folder: Path, copied: Iterable[str]) -> str | None:
    """Return why an interpreter will not find the script of a command; None if that is not known.

    Args:
        words: words of the command.
        folder: folder that its paths are relative to.
        copied: names of files in the work folder.
    """
    if not _INTERPRETER.fullmatch(Path(words[0]).name):
        return None
    script = next((word for word in words[1:] if word not in _FLAGS), "")
    if Path(script).suffix not in _SCRIPTS or script.startswith("-") or "{" in script:
        return None  # a name without a suffix may be a module or a class, or be completed
    if Path(words[0]).name == "java" and "-jar" not in words[1 : words.index(script)]:
        return None
    if os.path.normpath(script) in map(os.path.normpath, copied):
        return None
    if (folder / script).exists() or shutil.which(script):
        return None
    folder_of_script = (folder / script).parent
    suggestion = did_you_mean(Path(script).name, _files_of(folder_of_script))
    return (
        f"{script}: there is no such file beside the experiment file{suggestion}; the command runs in a "
        "separate work folder, into which simulation.files copies files"
    )


def _programs() -> list[str]:
    """Return the names of programs on the PATH."""
    names: set[str] = set()
    for folder in os.get_exec_path():
        with contextlib.suppress(OSError):
            names.update(entry.name for entry in os.scandir(folder))
    return sorted(names)


def resolve_word(word: str, folder: Path) -> str:
    """Return the path of the file that a command's word names, else the word itself."""
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
"""Number of last lines that are kept, and most characters of each."""
_LOGGED_CHARACTERS = 4096
"""Largest number of characters of a logged line."""
_LOGGED_LINES, _LOGGED_S = 10_000, 60.0
"""Largest number of lines that are logged in an interval, and its seconds. Logging a line takes longer than
printing it, and meanwhile the limits of the process are not checked."""
_CHUNK_BYTES = 1 << 16
"""Largest number of bytes per read."""
_SUMMARY_LINES = 3
"""Lines of output in a reason."""


class CapturedOutput:
    """The output of a process.

    Args:
        most: most bytes that it may print.
        keep: whether to keep all of the output, for a log.
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
        """Read available output; return False at its end."""
        data = os.read(descriptor, _CHUNK_BYTES)
        self.take(data)
        return bool(data)

    def take(self, data: bytes) -> None:
        """Process a piece of the output."""
        if self.is_too_much:
            return
        self._count += len(data)
        if self.all is not None:
            self.all += data
        lines, end, self._line = (self._line + data).rpartition(b"\n")
        if end:
            self._log_lines(lines)
        if len(self._line) > _CHUNK_BYTES:
            self._log_lines(self._line)
            self._line = b""

    def end(self) -> None:
        """Process the last line, which may lack a line end."""
        if self._line:
            self._log_lines(self._line)
            self._line = b""
        self._log_omitted()

    def _log_lines(self, data: bytes) -> None:
        """Log lines and keep the last ones, all at once, as a program may print millions."""
        now = time.monotonic()
        if now - self._logs_since >= _LOGGED_S:
            self._log_omitted()
            self._logged, self._logs_since = 0, now
        lines = data.decode("utf-8", "replace").replace("\r\n", "\n").removesuffix("\r").split("\n")
        for line in lines[-LINES:]:
            self._last.append(line if len(line) <= _LINE else f"{line[: _LINE - 3]}...")
        logged = lines[: _LOGGED_LINES - self._logged]
        self._logged += len(logged)
        self._omitted += len(lines) - len(logged)
        if logged:
            sys.stderr.write("".join(f"{line[:_LOGGED_CHARACTERS]}\n" for line in logged))

    def _log_omitted(self) -> None:
        """Log the number of omitted lines, and the last of them."""
        if self._omitted:
            last = list(self._last)[-self._omitted :]
            if len(last) < self._omitted:
                count = format_count(self._omitted - len(last), "line")
                last.insert(0, f"[{count} omitted: more than {_LOGGED_LINES} in {_LOGGED_S:g} s]")
            sys.stderr.write("".join(f"{line}\n" for line in last))
            self._omitted = 0

    @property
    def tail(self) -> str:
        """The last lines."""
        return "\n".join(self._last)

    @property
    def summary(self) -> str:
        """The last lines as a single one, for a reason; empty if nothing was printed."""
        # Without the marker lines of tracebacks.
        lines = [line.strip() for line in self._last if line.strip("^~ \t")]
        return " | ".join(lines[-_SUMMARY_LINES:])


_SIZE_CHECK_S = 0.25
"""Shortest interval between two measurements of the work folder, in seconds."""
MEGABYTE = 1_000_000


@dataclass(frozen=True)
class Limits:
    """Limits of an episode."""

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
        """Largest size of output in bytes."""
        return int(self.output * MEGABYTE)

    @property
    def largest(self) -> int:
        """Largest size of a file in bytes."""
        return int(self.disk * MEGABYTE)


class Watch:
    """Checks the limits of a running process."""

    def __init__(self, folder: Path, limits: Limits, processes: Processes) -> None:
        self._folder, self._limits, self._processes = folder, limits, processes
        self._looked, self._pause = time.monotonic(), _SIZE_CHECK_S
        self.deadline = time.monotonic() + limits.timeout

    def restart(self) -> None:
        """Restart the time limit for another episode."""
        self.deadline = time.monotonic() + self._limits.timeout

    @property
    def pause(self) -> float:
        """Seconds to wait until the next check."""
        return max(0.0, min(self.deadline - time.monotonic(), self._pause))

    def check(self, printed: CapturedOutput) -> None:
        """Raise CommandFailure if a limit is exceeded."""
        limits, now = self._limits, time.monotonic()
        if now >= self.deadline:
            raise CommandFailure(
                f"has not ended after {limits.timeout:g} s (simulation.timeout), and was killed"
            )
        if printed.is_too_much:
            raise CommandFailure(
                f"printed more than {limits.output:g} MB (simulation.output), and was killed"
            )
        if now - self._looked >= self._pause:
            self._processes.check()
            self.check_disk()
            took = time.monotonic() - now
            self._looked, self._pause = now, max(_SIZE_CHECK_S, 20 * took)

    def check_disk(self) -> None:
        """Raise CommandFailure if the work folder is too large."""
        if measure_size(self._folder) > self._limits.largest:
            raise CommandFailure(
                f"wrote more than {self._limits.disk:g} MB into its work folder (simulation.disk)"
            )


def run(
    processes: Processes,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    limits: Limits,
    printed: CapturedOutput,
) -> None:
    """Run a command to its end.

    Raises CommandFailure unless its exit status is 0 and no process is left.
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
        ended = _supervise(processes, reading, printed, watch)
        check_end(ended, limits)
        watch.check_disk()
    finally:
        printed.end()
        os.close(reading)


def _supervise(processes: Processes, reading: int, printed: CapturedOutput, watch: Watch) -> ExitReport:
    """Read the output until the process has ended; kill it if it exceeds a limit or on an interrupt."""
    poll = select.poll()
    poll.register(reading, select.POLLIN)
    poll.register(processes.channel, select.POLLIN)
    ended: ExitReport | None = None
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


def _drain(reading: int, printed: CapturedOutput) -> None:
    """Read the remaining output from the pipe."""
    os.set_blocking(reading, False)
    with suppress(BlockingIOError):
        while not printed.is_too_much and printed.read(reading):
            pass


def check_end(ended: ExitReport, limits: Limits) -> None:
    """Raise ProcessEnded if a process has failed or left others behind."""
    if ended.status < 0:
        name = signal.Signals(-ended.status).name
        reason = f": a file of more than {limits.disk:g} MB (simulation.disk)" if name == "SIGXFSZ" else ""
        raise ProcessEnded(f"was ended by {name}{reason}")
    if ended.status:
        raise ProcessEnded(f"ended with exit status {ended.status}")
    if ended.leftover and limits.children == "fail":
        names = ", ".join(ended.leftover)
        raise ProcessEnded(
            f"ended, but left processes behind, which were killed: {names}; have it wait for them, or set "
            "simulation.children: end"
        )
