"""A proxy in front of a broker that delays, doubles and cuts, as bad networks and what stands in them do."""

import asyncio
import contextlib
import random
from collections import Counter

from tests.system.proxy import Proxy

PUBLISH, QOS = 0x30, 0x06
STEPS = (b"sensor", b"actuator")
"""Messages of a single step have no number, so that one that comes twice counts as the next: not doubled."""


class FaultProxy(Proxy):
    """Passes MQTT packets on to 127.0.0.1:`port`, until leaving the context; `url` is where it listens.

    delayed, doubled: shares of the packets; delay: the most, in seconds; packets never overtake each other.
    lifetime: seconds for which a connection lasts, on average.
    """

    def __init__(
        self,
        port: int,
        seed: int,
        *,
        delayed: float = 0.05,
        delay: float = 0.01,
        doubled: float = 0.1,
        lifetime: float = 3.0,
    ) -> None:
        super().__init__(port)
        self.faults: Counter[str] = Counter()
        """How often each kind of fault has been made."""
        self._draw = random.Random(seed)
        self._delayed, self._delay, self._doubled, self._lifetime = delayed, delay, doubled, lifetime
        self._writers: set[asyncio.StreamWriter] = set()

    def cut(self) -> None:
        """End all connections; new ones can be made."""

        def abort() -> None:
            for one in list(self._writers):
                one.transport.abort()

        self._loop.call_soon_threadsafe(abort)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers = [writer]
        try:
            there, onwards = await asyncio.open_connection("127.0.0.1", self._port)
            writers.append(onwards)
            self._writers.update(writers)
            ways = (self._pass(reader, onwards), self._pass(there, writer))
            tasks = [asyncio.ensure_future(way) for way in ways]
            lasts = self._draw.expovariate(1 / self._lifetime)
            done, pending = await asyncio.wait(tasks, timeout=lasts, return_when=asyncio.FIRST_COMPLETED)
            self.faults["cut"] += not done
            for task in pending:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        except (OSError, asyncio.CancelledError):
            pass  # The broker is away, or the test is over.
        finally:
            self._writers.difference_update(writers)
            for each in writers:
                each.transport.abort()

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One direction, packet by packet."""
        with contextlib.suppress(asyncio.IncompleteReadError, OSError):
            while True:
                header, body = await _packet(reader)
                if self._draw.random() < self._delayed:
                    self.faults["delayed"] += 1
                    await asyncio.sleep(self._draw.random() * self._delay)
                twice = _may_come_twice(header, body) and self._draw.random() < self._doubled
                self.faults["doubled"] += twice
                writer.write((header + body) * (1 + twice))
                await writer.drain()


async def _packet(reader: asyncio.StreamReader) -> tuple[bytes, bytes]:
    """Fixed header and rest of the next packet (MQTT 5, section 2.1)."""
    header = await reader.readexactly(2)
    while header[-1] & 0x80:
        header += await reader.readexactly(1)
    length = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(header[1:]))
    return header, await reader.readexactly(length)


def _may_come_twice(header: bytes, body: bytes) -> bool:
    """Whether it is a message of QoS 0, and none of a single step."""
    topic = body[2 : 2 + int.from_bytes(body[:2], "big")]
    return header[0] & 0xF0 == PUBLISH and not header[0] & QOS and not topic.endswith(STEPS)
