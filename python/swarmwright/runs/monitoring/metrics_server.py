"""The web server behind `--metrics`: a page for Prometheus, with a limited number of threads."""

import socket
import socketserver
import sys
import threading
import time
from http.server import HTTPServer
from typing import TYPE_CHECKING, Any

from prometheus_client import MetricsHandler

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry

MAX_CONNECTIONS = 16
"""Largest number of simultaneous connections; a new one closes the oldest."""
MAX_CONNECTION_S = 10.0
"""Longest duration of a connection."""


class MetricsServer(socketserver.ThreadingMixIn, HTTPServer):
    """Serves the metrics of a registry in background threads.

    host: name or address to listen on. port: 0 for any free port.

    Raises OSError when it cannot listen on the address, UnicodeError for an invalid host.
    """

    daemon_threads = True
    request_queue_size = 16

    def __init__(self, host: str, port: int, registry: "CollectorRegistry") -> None:
        self._lock = threading.Lock()
        self._began: dict[socket.socket, float] = {}
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        self.address_family = addresses[0][0]
        super().__init__((host, port), MetricsHandler.factory(registry))

    def process_request(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - the base class's
        """Answer in a thread."""
        with self._lock:
            while len(self._began) >= MAX_CONNECTIONS:
                self._end(next(iter(self._began)))
            self._began[request] = time.monotonic()
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:  # noqa: ANN401
        """Forget a connection that has ended."""
        with self._lock:
            self._began.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """End connections that last too long; called twice a second."""
        with self._lock:
            oldest = time.monotonic() - MAX_CONNECTION_S
            for request in [request for request, began in self._began.items() if began < oldest]:
                self._end(request)

    def _end(self, request: socket.socket) -> None:
        """End a connection; its thread reads the end and stops."""
        del self._began[request]
        try:
            request.shutdown(socket.SHUT_RDWR)
        except OSError:
            return  # it has disconnected meanwhile

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
        """Ignore clients that disconnect before they have their answer."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)
