"""What a simulation looks like at one moment."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Self


@dataclass(frozen=True)
class Body:
    """One thing in a scene.

    kind: agent, defender, goal, exit, blockade, obstacle, ... state: free, arrived, caught, crashed, out, or
    empty. x, y, radius: in the scene's unit, metres or cells; y points up; radius 0 is a point.
    """

    kind: str
    x: float
    y: float
    state: str = ""
    radius: float = 0.0


@dataclass(frozen=True)
class Scene:
    """A two-dimensional world at one step; (0, 0) is at the bottom left.

    width, height: its extent in metres or cells. message: a line to show above. bodies: what lies below
    first. grid: whether it consists of cells, which people number from (0, 0) at the top left.
    """

    width: float
    height: float
    step: int
    message: str
    bodies: Sequence[Body]
    grid: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a scene as the engine writes it (JSON)."""
        raw = json.loads(text)
        bodies = tuple(
            Body(body["kind"], body["x"], body["y"], body["state"], body["radius"]) for body in raw["bodies"]
        )
        return cls(raw["width"], raw["height"], raw["step"], raw["message"], bodies, raw["grid"])

    def json(self) -> str:
        """Write it as the engine reads it. Raises ValueError for numbers that are not finite."""
        raw = {**vars(self), "bodies": [asdict(body) for body in self.bodies]}
        return json.dumps(raw, allow_nan=False, default=float)

    def of_kind(self, *kinds: str) -> list[Body]:
        """The bodies of these kinds, in their order."""
        return [body for body in self.bodies if body.kind in kinds]
