"""Processes of a command, started and ended by a keeper of their own."""

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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from swarmwright.common import hash_seed
from swarmwright.common.suggestions import did_you_mean, nearest
from swarmwright.simulations.command.failure import CommandFailure

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
            "environment": {**hash_seed.variables(), **environment, _MARK: self._mark},
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
    near = get_close_matches(program, _programs(), n=1, cutoff=_SIMILAR_SPELLING)
    return f"; did you mean '{near[0]}'?" if near else ""


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
