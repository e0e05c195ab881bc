"""The broker between the kit and its peer, and a proxy that the kit closes to test reconnecting."""

import contextlib
import socket
import threading
from contextlib import ExitStack
from urllib.parse import urlsplit

from swarmwright import _engine

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
