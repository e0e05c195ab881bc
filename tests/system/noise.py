"""Foreign traffic: what others publish on the same broker by mistake or for purposes of their own."""

import itertools
import json
import threading
from typing import Self

from tests.system.peer import PRESENCE, TOPICS, Peer

UNKNOWN = "f" * 64
MEGABYTE = b'{"simulation_hash": "' + b"x" * 1_000_000 + b'"}'


def _json(**fields: object) -> bytes:
    return json.dumps(fields).encode()


ANYWHERE: tuple[bytes, ...] = (
    b"",
    b"hello",
    b"\xff\xfe\x00",
    b"[]",
    b"{}",
    b"42",
    b"null",
    b'{"simulation_hash": 1}',
    b'{"simulation_hash": "'
    + UNKNOWN.encode()
    + b'", "agent": 0, "sensor": [NaN], "actuator": [NaN], "fitness": NaN}',
    b"[" * 10_000,
    _json(
        server="one",
        simulation_hash=None,
        simulation=7,
        run="yes",
        agent="a",
        sensor={},
        actuator="x",
        fitness="1",
    ),
)
"""Junk for every topic."""

PARTICULAR: tuple[tuple[str, bytes], ...] = (
    ("discovery", _json(simulation="chess", simulation_hash=UNKNOWN, requirements={"dimensions": 2})),
    ("discovery", _json(simulation="minisim", simulation_hash=UNKNOWN, requirements={"dimensions": 3})),
    (
        "server",
        _json(server=1, simulation_hash=UNKNOWN, simulations=["minisim"], capabilities={"dimensions": 2}),
    ),
    ("parameters", _json(server=99, simulation_hash=UNKNOWN, maxSteps=1)),
    ("control", _json(server=99, simulation_hash=UNKNOWN, run=True)),
    ("control", _json(server=1, simulation_hash=UNKNOWN, run=True, tool="a stranger")),
    ("control", _json(server=1, simulation_hash=UNKNOWN, run=False)),
    ("sensor", _json(simulation_hash=UNKNOWN, agent=0, sensor=[1, 2, 3, 4])),
    ("sensor", _json(simulation_hash=UNKNOWN, agent=2**40, sensor=[1])),
    ("actuator", _json(simulation_hash=UNKNOWN, agent=0, actuator=[1])),
    ("actuator", _json(simulation_hash=UNKNOWN, agent=-1, actuator=[1, 2, 3])),
    ("fitness", _json(simulation_hash=UNKNOWN, fitness=1e6)),
    (f"{PRESENCE}none", b"hello"),
    (f"{PRESENCE}99", b'{"version": 1}'),
    ("elsewhere/sensor", b"hello"),
)
"""Well-formed messages that mean nobody here, and junk on other topics."""


def leave_retained(peer: Peer) -> None:
    """Leave a retained message on every topic, and the presence of a server that is long gone."""
    for topic in TOPICS:
        peer.publish(
            topic, _json(server=1, simulation_hash=UNKNOWN, run=True, fitness=1e6), retain=True, qos=1
        )
    ghost = {
        "version": 1,
        "server": 77,
        "state": "ready",
        "simulations": ["minisim"],
        "capabilities": {"dimensions": 2},
        "since": "2017-06-01T00:00:00Z",
    }
    peer.publish(f"{PRESENCE}77", json.dumps(ghost), retain=True, qos=1)


class Noise(Peer):
    """Publishes junk from its making to its closing, some hundred messages a second."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        self.rounds = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._babble, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def _babble(self) -> None:
        junk = [(topic, payload) for topic, payload in itertools.product(TOPICS, ANYWHERE)]
        for topic, payload in itertools.cycle([*junk, *PARTICULAR]):
            self.publish(topic, payload)
            if self._stop.wait(0.002):
                return
            if topic == PARTICULAR[-1][0]:
                self.publish(TOPICS[self.rounds % len(TOPICS)], MEGABYTE)
                self.rounds += 1

    def close(self) -> None:
        self._stop.set()
        self._thread.join(10)
        super().close()
