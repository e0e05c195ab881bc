"""What differs from uvicorn: idle connections are closed, and streams end before the server does."""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

PATIENCE_S = 15.0
"""For a connection to send the head of a request."""


class Connection(H11Protocol):
    """A connection that is closed when no request comes, so that a client cannot hold all of them."""

    _timer: asyncio.TimerHandle | None = None
    _last: RequestResponseCycle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a request."""
        super().connection_made(transport)
        self._timer = self.loop.call_later(PATIENCE_S, self._check)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def _check(self) -> None:
        cycle: RequestResponseCycle | None = self.cycle
        if cycle is self._last and (cycle is None or cycle.response_complete):
            self.transport.close()
            return
        self._last = cycle
        self._timer = self.loop.call_later(PATIENCE_S, self._check)


class Server(uvicorn.Server):
    """A server that ends its streams first.

    Args:
        config: of uvicorn.
        end_streams: lets all responses that would go on for ever end.
    """

    def __init__(self, config: uvicorn.Config, end_streams: Callable[[], Awaitable[None]]) -> None:
        super().__init__(config)
        self._end_streams = end_streams

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End. Connections whose clients do not read are cut, which uvicorn would log with a traceback."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await self._end_streams()
        await super().shutdown(sockets)
