"""What a simulation looks like at one moment."""

import json
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class Body:
    """One thing in a scene.

    kind: agent, defender, goal, exit, blockade, ... state: free, arrived, caught, or empty.
    x, y, radius: in the scene's unit, metres or cells; y points up; radius 0 is a point.
    """

    kind: str
    x: float
    y: float
    state: str
    radius: float


@dataclass(frozen=True)
class Scene:
    """A two-dimensional world at one step.

    width, height: its extent in metres or cells. message: a line to show above. grid: whether it consists of
    cells, which people number from (0, 0) at the top left.
    """

    width: float
    height: float
    step: int
    message: str
    bodies: tuple[Body, ...]
    grid: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a scene as the engine writes it (JSON)."""
        raw = json.loads(text)
        bodies = tuple(
            Body(body["kind"], body["x"], body["y"], body["state"], body["radius"]) for body in raw["bodies"]
        )
        return cls(raw["width"], raw["height"], raw["step"], raw["message"], bodies, raw["grid"])

    def of_kind(self, *kinds: str) -> list[Body]:
        """The bodies of these kinds, in their order."""
        return [body for body in self.bodies if body.kind in kinds]
