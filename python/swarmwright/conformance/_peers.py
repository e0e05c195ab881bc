"""The peer that the kit starts (`--exec`), and the broker between the kit and its peer."""

import contextlib
import os
import re
import shlex
import signal
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from urllib.parse import urlsplit

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean

_CHUNK_BYTES = 1 << 16
"""Bytes forwarded at a time."""


class Door:
    """A proxy on a free loopback port that forwards all bytes to the broker.

    Args:
        host: host of the broker.
        port: port of the broker.

    """

    def __init__(self, host: str, port: int) -> None:
        self._broker = (host, port)
        self._open = True
        self._lock = threading.Lock()
        self._links: list[tuple[socket.socket, socket.socket]] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def url(self) -> str:
        """The address for the peer."""
        return f"mqtt://127.0.0.1:{self.port}"

    def shut(self) -> None:
        """Break all connections, and refuse new ones."""
        with self._lock:
            self._open = False
            links, self._links = self._links, []
        for link in links:
            _end(*link)

    def open(self) -> None:
        """Accept connections again."""
        with self._lock:
            self._open = True

    def close(self) -> None:
        """Break all connections and stop listening."""
        self.shut()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _listen(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with self._lock:
                if not self._open:
                    client.close()
                    continue
                try:
                    far = socket.create_connection(self._broker, 5)
                except OSError:
                    client.close()
                    continue
                far.settimeout(None)
                self._links.append((client, far))
            for end in (client, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for pair in ((client, far), (far, client)):
                threading.Thread(target=_pass_on, args=pair, daemon=True).start()


def _pass_on(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(_CHUNK_BYTES):
            sink.sendall(data)
    _end(source, sink)


def _end(*links: socket.socket) -> None:
    for link in links:
        with contextlib.suppress(OSError):
            link.shutdown(socket.SHUT_RDWR)
        link.close()


OPEN = (
    "The kit's broker admits every user of this machine, since peers need not have accounts; "
    "--broker names another."
)


def open_broker(
    broker: str | None, stack: ExitStack, *, stranger: bool
) -> tuple[str, str | None, Door | None]:
    """Yield the address of the broker for the kit, and the proxy for the peer.

    The embedded broker admits every client, since peers need not have accounts.

    stranger: whether another party starts the peer and knows the broker's address.
    """
    if broker is None:
        embedded = _engine.Broker()
        stack.callback(embedded.stop)
        address, direct = embedded.url, embedded.url
    else:
        address, direct = broker, None
    parts = urlsplit(address)
    if parts.scheme != "mqtt" or (broker is not None and stranger):
        return address, direct, None
    assert parts.hostname is not None
    door = Door(parts.hostname, parts.port or 1883)
    stack.callback(door.close)
    return address, direct, door


_PLACEHOLDER = re.compile(r"(?<!\$)\{([A-Za-z_]\w*)\}")
"""A word in braces, except for shell variables."""
GRACE_S = 10.0
"""Seconds to wait for an orderly exit."""


class Process:
    """A command with placeholders such as {broker}; started in a new process group.

    Args:
        command: as typed in a shell; no shell is involved.
        values: returns the values of the placeholders, called for each start.

    Raises InputError if the command cannot be parsed or started.

    """

    def __init__(self, command: str, values: Callable[[], Mapping[str, object]]) -> None:
        self.command = command
        self._values = values
        if not self._words({}):
            raise InputError("--exec: is empty; write the command that starts the peer")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._process: subprocess.Popen[bytes] | None = None
        self._marked = 0

    def _words(self, values: Mapping[str, object]) -> list[str]:
        command = self.command
        if values:
            self._check_placeholders(values)
        for name, value in values.items():
            command = command.replace(f"{{{name}}}", shlex.quote(str(value)))
        try:
            return shlex.split(command)
        except ValueError as error:
            raise InputError(f"--exec: {command!r} cannot be read: {error}") from None

    def _check_placeholders(self, values: Mapping[str, object]) -> None:
        for name in _PLACEHOLDER.findall(self.command):
            if name not in values:
                placeholders = ", ".join(f"{{{value}}}" for value in values)
                hint = did_you_mean(name, list(values))
                raise InputError(
                    f"--exec: {{{name}}} is not one of the placeholders {placeholders}{hint or ';'} "
                    "what needs braces itself goes into a script"
                )

    def another(self) -> "Process":
        """Return a second process with the same command."""
        return Process(self.command, self._values)

    def start(self) -> None:
        """Start or restart the process."""
        self.stop()
        words = self._words(self._values())
        try:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                start_new_session=True,
            )
        except OSError as error:
            raise InputError(f"--exec: {words[0]}: {error.strerror}") from None

    @property
    def ended(self) -> str:
        """Description of the exit with the last output; empty while the process runs."""
        status = None if self._process is None else self._process.poll()
        if status is None:
            return ""
        how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with {status}"
        return f"the process {how}{self.words}"

    @property
    def words(self) -> str:
        """The end of the output, to append to a sentence; empty without output."""
        return self._last_words(0)

    def mark(self) -> None:
        """Make `new_words` start at the present end of the output."""
        self._marked = self._count_printed_bytes()

    @property
    def new_words(self) -> str:
        """The end of the output since `mark`, like `words`."""
        return self._last_words(self._marked)

    def _count_printed_bytes(self) -> int:
        return os.fstat(self._said.fileno()).st_size

    def _last_words(self, start: int) -> str:
        start = max(start, self._count_printed_bytes() - 2000)
        text = os.pread(self._said.fileno(), 2000, start).decode("utf-8", "replace").strip()
        lines = [f"\n    {line}" for line in text.splitlines()[-5:]]
        return f"; it said last:{''.join(lines)}" if lines else ""

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs."""
        return None if self._process is None else self._process.poll()

    def wait(self, seconds: float) -> int | None:
        """Wait for the exit status; return None if it does not end in time."""
        assert self._process is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self._process.wait(seconds)
        return None

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children."""
        if self._process is not None and self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)

    def stop(self) -> None:
        """Terminate the process; kill it if it does not exit."""
        if self._process is None:
            return
        self.signal(signal.SIGTERM)
        if self.wait(GRACE_S) is None:
            self.signal(signal.SIGKILL)
            self._process.wait()

    def close(self) -> None:
        """Stop the process and close its output file."""
        self.stop()
        self._said.close()
