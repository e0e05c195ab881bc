"""Connections of browsers: those that ask nothing are closed."""

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

PATIENCE_S = 15.0
"""For a connection to send the head of a request."""


class Connection(H11Protocol):
    """A connection that is closed when no request comes: a client could hold all there may be."""

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
