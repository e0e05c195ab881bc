"""Processes of a simulation's command: started, and ended with all their descendants.

This is a separate program that needs only Python's standard library: `python -I -S keeper.py DESCRIPTOR`,
where the descriptor is a Unix socket of packets. It adopts processes whose parents end, including those that
have left their session, so that it can find all of them. When the other end of the socket closes, for
whatever reason, it asks the processes to end, and kills those that do not.

Packets are JSON objects. `{"start": {"command", "folder", "environment", "largest"}}`, with the descriptors
of standard input, output and error, is answered with `{"started": PID}` or `{"refused": [ERRNO, TEXT]}`.
`{"kill": SECONDS}` asks the process to end, and kills it after that time. When the process has ended, and its
descendants have been killed, `{"ended": STATUS, "left": [names of processes]}` is sent.
"""

import contextlib
import ctypes
import json
import os
import resource
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

_LINGER_S = 0.3
"""Seconds that the descendants of a command may take to end after it."""
_GRACE_S = 2.0
"""Seconds that processes have to end when the other end of the socket has closed."""
_SUBREAPER, _DEATH_SIGNAL = 36, 1
_LARGEST_MESSAGE_BYTES = 1 << 20
"""Largest size of a message of the parent in bytes."""
_IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LINUX = sys.platform == "linux"


def _control(option: int, value: int) -> None:
    if _LINUX:
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _descendants() -> dict[int, str]:
    """Return the running descendants of this process: id -> name."""
    parents: dict[int, tuple[int, str, str]] = {}
    for entry in os.listdir("/proc") if _LINUX else ():  # noqa: PTH208 - a hundred times a second
        if not entry.isdigit():
            continue
        with contextlib.suppress(OSError, ValueError):
            text = Path(f"/proc/{entry}/stat").read_text("utf-8", "replace")
            name, _, rest = text.partition("(")[2].rpartition(")")
            state, parent = rest.split()[:2]
            parents[int(entry)] = int(parent), state, name
    descendants: dict[int, str] = {}
    mine = {os.getpid()}
    while mine:
        mine = {pid for pid, (parent, _, _) in parents.items() if parent in mine}
        descendants |= {pid: parents[pid][2] for pid in mine if parents[pid][1] not in "ZX"}
    return descendants


def _reap(process: "subprocess.Popen[bytes] | None") -> None:
    """Collect ended processes that no other process waits for."""
    if process is not None:
        process.poll()
    waiting = process is not None and process.returncode is None
    with contextlib.suppress(ChildProcessError):
        while True:
            if waiting:
                ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
                if ended is None:
                    return
                if process is not None and ended.si_pid == process.pid:
                    process.poll()
                    waiting = False
                    continue
                os.waitpid(ended.si_pid, os.WNOHANG)
            elif os.waitpid(-1, os.WNOHANG)[0] == 0:
                return


class Keeper:
    """The program's main loop."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._process: subprocess.Popen[bytes] | None = None
        self._wake, write = os.pipe()
        os.set_blocking(write, False)
        os.set_blocking(self._wake, False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(write, warn_on_full_buffer=False)

    def run(self) -> None:
        """Serve until the other end is closed."""
        while True:
            readable, _, _ = select.select([self._channel.fileno(), self._wake], [], [])
            if self._wake in readable:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._wake, 4096)
                _reap(self._process)
                if self._process is not None and self._process.returncode is not None:
                    self._report_end()
            if self._channel.fileno() in readable:
                try:
                    data, descriptors, _, _ = socket.recv_fds(self._channel, _LARGEST_MESSAGE_BYTES, 3)
                except ConnectionResetError:  # closed with unread reports
                    data, descriptors = b"", []
                if not data:
                    if self._process is not None:
                        self._kill(_GRACE_S)
                    return
                self._handle(json.loads(data), descriptors)

    def _handle(self, request: "dict[str, object]", descriptors: "list[int]") -> None:
        start = request.get("start")
        if isinstance(start, dict):
            self._start(start, descriptors)
        elif self._process is not None:  # else its end has just been reported
            self._kill(float(str(request["kill"])))

    def _start(self, request: "dict[str, object]", descriptors: "list[int]") -> None:
        command, largest, me = request["command"], int(str(request["largest"])), os.getpid()

        def ready() -> None:
            for ignored in _IGNORED:
                signal.signal(ignored, signal.SIG_DFL)
            _control(_DEATH_SIGNAL, signal.SIGKILL)
            if os.getppid() != me:
                os._exit(1)
            for limit, value in ((resource.RLIMIT_FSIZE, largest), (resource.RLIMIT_CORE, 0)):
                hard = resource.getrlimit(limit)[1]
                resource.setrlimit(limit, (value if hard == -1 else min(value, hard), hard))

        try:
            self._process = subprocess.Popen(
                command,  # type: ignore[call-overload]
                cwd=request["folder"],
                env={**os.environ, **request["environment"]},  # type: ignore[dict-item]
                stdin=descriptors[0],
                stdout=descriptors[1],
                stderr=descriptors[2],
                start_new_session=True,
                preexec_fn=ready,  # noqa: PLW1509 - this process has one thread
            )
        except (OSError, subprocess.SubprocessError, ValueError) as error:
            number = getattr(error, "errno", None) or 0
            self._report({"refused": [number, getattr(error, "strerror", None) or str(error)]})
        else:
            self._report({"started": self._process.pid})
        finally:
            for descriptor in descriptors:
                os.close(descriptor)

    def _kill(self, patience: float) -> None:
        """Ask the process to end, then kill it and its descendants."""
        assert self._process is not None
        if patience:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGTERM)
            until = time.monotonic() + patience
            while time.monotonic() < until and self._process.poll() is None:
                time.sleep(0.01)
        self._kill_all()
        self._process.wait()
        self._report_end(())

    def _report_end(self, leftover: "tuple[str, ...] | None" = None) -> None:
        """Report the end of the process, once its descendants have ended."""
        assert self._process is not None
        status, self._process = self._process.returncode, None
        if leftover is None:
            until = time.monotonic() + _LINGER_S
            while (names := _descendants()) and time.monotonic() < until:
                time.sleep(0.005)
                _reap(None)
            leftover = tuple(names.values())
            if names:
                self._kill_all()
        self._report({"ended": status, "left": sorted(leftover)[:10]})

    def _kill_all(self) -> None:
        """Kill all descendants, until there are none."""
        if not _LINUX and self._process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        until = time.monotonic() + 10.0
        while (descendants := _descendants()) and time.monotonic() < until:
            for pid in descendants:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.001)
            _reap(self._process)

    def _report(self, report: "dict[str, object]") -> None:
        # If the other end has closed, `run` notices.
        with contextlib.suppress(OSError):
            self._channel.send(json.dumps(report).encode())


def main() -> None:
    """Serve until the other end of the socket is closed."""
    for signals in _IGNORED:
        signal.signal(signals, signal.SIG_IGN)
    _control(_SUBREAPER, 1)
    with socket.socket(fileno=int(sys.argv[1])) as channel:
        channel.set_inheritable(False)
        Keeper(channel).run()


if __name__ == "__main__":
    main()
