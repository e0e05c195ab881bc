"""A plain server that also sends scenes, written from docs/reference/protocol.md with paho and msgpack."""

import math
import struct
from typing import Any

import msgpack

from tests.system.plain_server import TITLE, Json, PlainServer


def floats(*numbers: float) -> bytes:
    """An array of binary32."""
    return struct.pack(f"<{len(numbers)}f", *numbers)


def indices(*numbers: int) -> bytes:
    """An array of unsigned 32-bit integers."""
    return struct.pack(f"<{len(numbers)}I", *numbers)


class SceneServer(PlainServer):
    """Offers the toy with scenes. `sent`: how many scenes there were; subclasses misbehave."""

    def __init__(self, url: str, server: int = 4711, **options: Any) -> None:
        self.sent = 0
        self.reply: str | None = None
        announced = {"version": 1, "metrics": ["met", "steps", "mean"], "scenes": True}
        super().__init__(url, server, capabilities={"dimensions": 1, "swarmwright": announced}, **options)

    def controlled(self, content: Json) -> None:
        if content.get("run", True):
            wanted = isinstance(content.get("scenes"), list)
            self.reply = content.get("reply") if wanted else None
        super().controlled(content)

    def sense(self) -> None:
        if self.reply is not None:
            self.show(self.reply, self.picture())
        super().sense()

    def show(self, topic: str, scene: Json) -> None:
        """Send a scene."""
        self.sent += 1
        self._client.publish(topic, msgpack.packb(scene))

    def picture(self) -> Json:
        """The scene as it is now: agents on a line 20 wide, each looking to where 0 is, and the goal."""
        toy = self._toy
        assert toy is not None
        places = [place + 10 for place in toy.places]
        states = [0 if agent in toy.acting else 1 for agent in range(len(places))]
        return {
            "kind": "scene",
            "version": 1,
            "server": self.server,
            "simulation_hash": self._hash,
            "step": toy.step,
            "fitness": toy.fitness,
            "metrics": {name: value for name, value in toy.metrics.items() if value is not None},
            "seconds": 0.1,
            "width": 20,
            "height": 4,
            "message": "Meet at 0",
            "bodies": {
                "looks": [["agent", "free"], ["agent", "arrived"], ["goal", ""]],
                "look": indices(2, *states),
                "x": floats(10, *places),
                "y": floats(*[2] * (1 + len(places))),
                "radius": floats(0.3),
                "heading": floats(math.nan, *(math.pi if place > 10 else 0.0 for place in places)),
                "labels": ["", *(f"{place - 10:.1f}" for place in places)],
            },
            "rays": {"body": indices(1), "angle": floats(0), "start": floats(0.3), "length": floats(2)},
            "links": indices(1, 2),
            "floor": {"grey": 0.9},
            "walls": [{"points": [[0, 0], [20, 0]]}],
            "styles": [{"kind": "goal", "color": "#0072b2", "shape": "star"}],
        }

    def extras(self) -> Json:
        assert self._toy is not None
        return {"metrics": self._toy.metrics}


__all__ = ["TITLE", "SceneServer"]
