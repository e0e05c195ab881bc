"""What a simulation looks like at one moment."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from swarmwright.core.engine_types import BodyFields, SceneFields


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
    def of(cls, fields: SceneFields) -> Self:
        """Make a scene of what the engine returns."""
        bodies = tuple(Body(**body) for body in fields["bodies"])
        return cls(
            fields["width"], fields["height"], fields["step"], fields["message"], bodies, fields["grid"]
        )

    def plain(self) -> SceneFields:
        """Return what the engine takes. Raises ValueError or TypeError for what is not a finite number."""
        return {
            "width": _number("width", self.width),
            "height": _number("height", self.height),
            "grid": bool(self.grid),
            "step": self.step,
            "message": self.message,
            "bodies": [_plain(f"bodies[{index}]", body) for index, body in enumerate(self.bodies)],
        }

    def of_kind(self, *kinds: str) -> list[Body]:
        """The bodies of these kinds, in their order."""
        return [body for body in self.bodies if body.kind in kinds]


def _plain(place: str, body: Body) -> BodyFields:
    return {
        "kind": body.kind,
        "x": _number(f"{place}.x", body.x),
        "y": _number(f"{place}.y", body.y),
        "state": body.state,
        "radius": _number(f"{place}.radius", body.radius),
    }


def _number(place: str, value: Any) -> float:  # noqa: ANN401 - whatever the code of a simulation says
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{place}: {value} found, expected a finite number")
    return number
