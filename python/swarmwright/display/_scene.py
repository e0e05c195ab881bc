"""What a simulation looks like at one moment."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common.engine_types import (
    BodyFields,
    PatchFields,
    RayFields,
    SceneFields,
    StyleFields,
)

if TYPE_CHECKING:
    from swarmwright.common.engine_types import LightFields, WallFields

Point = tuple[float, float]
"""x and y, in the scene's unit."""

STYLE_SHAPES = ("circle", "cross", "triangle", "star", "square", "diamond", "pentagon", "hexagon")
"""What a style can have."""


@dataclass(frozen=True)
class Ray:
    """The line of sight of a body's sensor.

    angle: from the body's heading, radians counter-clockwise. length: how far it goes from where it begins,
    `start` from the middle of the body, in the scene's unit. reading: what the sensor says, 0 to 1.
    """

    angle: float
    length: float
    start: float = 0.0
    reading: float | None = None


@dataclass(frozen=True)
class Body:
    """One thing in a scene.

    kind: agent, defender, goal, exit, blockade, obstacle, ... state: free, arrived, caught, crashed, out, or
    empty. x, y, radius: in the scene's unit, metres or cells; y points up; radius 0 is a point. heading:
    where it looks, radians counter-clockwise from the x axis; bodies with a heading are drawn in their true
    size (with radius 0, as large as marks), those of the kind wall as lines, as far to both sides as the
    radius says. A body of the kind led is drawn on top of others, and left out without a state: so LEDs of
    robots can be on and off. value: a number that gives it a colour, see `Scale`. label: a short text beside
    it. agent: which agent it is; bodies of the kind agent that do not say so are the agents in their order.
    """

    kind: str
    x: float
    y: float
    state: str = ""
    radius: float = 0.0
    heading: float | None = None
    value: float | None = None
    label: str = ""
    agent: int | None = None
    rays: Sequence[Ray] = ()


@dataclass(frozen=True)
class Patch:
    """A part of the floor: a polygon, or a circle around its only point.

    grey: 0 black to 1 white. points: corners in order. name: what legends call it.
    """

    grey: float
    points: Sequence[Point] = ()
    radius: float = 0.0
    name: str = ""

    @classmethod
    def circle(cls, x: float, y: float, radius: float, grey: float, name: str = "") -> Self:
        """Return a circle around a point."""
        return cls(grey, ((x, y),), radius, name)

    @classmethod
    def rectangle(cls, low: Point, high: Point, grey: float, name: str = "") -> Self:
        """Return a rectangle from its lower left to its upper right corner."""
        return cls(grey, (low, (high[0], low[1]), high, (low[0], high[1])), 0.0, name)


@dataclass(frozen=True)
class Wall:
    """A line from point to point, or with `solid` the corners of a polygon that is filled."""

    points: Sequence[Point]
    solid: bool = False


@dataclass(frozen=True)
class Light:
    """A lamp; intensity 0 is off."""

    x: float
    y: float
    intensity: float = 1.0


@dataclass(frozen=True)
class Style:
    """The look of bodies of a kind and state.

    color: "#rrggbb", or empty for what they get anyway; on dark pages it is lightened where needed. shape:
    circle, cross, triangle, star, square, diamond, pentagon, hexagon, or empty. Without a state it holds for
    all states of the kind that have no style.
    """

    kind: str
    state: str = ""
    color: str = ""
    shape: str = ""


@dataclass(frozen=True)
class Scale:
    """What the values of bodies are: a name with the unit, and the values with the first and last colour."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Scene:
    """A two-dimensional world at one step; positions are from its bottom left corner.

    width, height: its extent in metres or cells. message: a line to show above. bodies: what lies below
    first; a list of `Body`, or `Bodies` for thousands. grid: whether it consists of cells, which people
    number from (0, 0) at the top left.

    floor: its colour, 0 black to 1 white, or a patch where it does not fill the world. patches: parts of the
    floor with colours of their own, what lies below first; they end where the floor ends. walls, lights: what
    stands there. links: pairs of indices of bodies, of which the second hears the first. styles: looks that
    the simulation chooses. scale: what the values of bodies are; left out: from the least to the greatest.

    origin: where the bottom left corner is in the simulation's own coordinates, (x, y): axes show those.
    """

    width: float
    height: float
    step: int
    message: str
    bodies: Sequence[Body]
    grid: bool = False
    floor: float | Patch | None = None
    patches: Sequence[Patch] = ()
    walls: Sequence[Wall] = ()
    lights: Sequence[Light] = ()
    links: Sequence[tuple[int, int]] = ()
    styles: Sequence[Style] = ()
    scale: Scale | None = None
    origin: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, fields: SceneFields) -> Self:
        """Make a scene of what the engine returns."""
        rays: dict[int, list[Ray]] = {}
        for ray in fields.get("rays", []):
            made = Ray(ray["angle"], ray["length"], ray["start"], ray.get("reading"))
            rays.setdefault(ray["body"], []).append(made)
        bodies = tuple(
            Body(**body, rays=tuple(rays.get(index, ()))) for index, body in enumerate(fields["bodies"])
        )
        return cls.around(fields, bodies, [(first, second) for first, second in fields.get("links", [])])

    @classmethod
    def around(cls, fields: SceneFields, bodies: Sequence[Body], links: Sequence[tuple[int, int]]) -> Self:
        """Make a scene of these bodies and links; all else is the engine's."""
        floor, scale = fields.get("floor"), fields.get("scale")
        return cls(
            fields["width"],
            fields["height"],
            fields["step"],
            fields["message"],
            bodies,
            fields["grid"],
            None if floor is None else _patch(floor),
            tuple(_patch(patch) for patch in fields.get("patches", [])),
            tuple(
                Wall(tuple((x, y) for x, y in wall["points"]), wall["solid"])
                for wall in fields.get("walls", [])
            ),
            tuple(Light(**light) for light in fields.get("lights", [])),
            links,
            tuple(Style(**style) for style in fields.get("styles", [])),
            None if scale is None else Scale(**scale),
            _pair(fields.get("origin", [0.0, 0.0])),
        )

    def plain(self) -> SceneFields:
        """Return what the engine takes. Raises ValueError or TypeError for what cannot be drawn."""
        bodies = list(self.bodies)
        fields: SceneFields = {
            "width": _number("width", self.width),
            "height": _number("height", self.height),
            "grid": bool(self.grid),
            "step": self.step,
            "message": self.message,
            "bodies": [_plain(f"bodies[{index}]", body) for index, body in enumerate(bodies)],
        }
        origin = _point("origin", self.origin)
        if any(origin):
            fields["origin"] = origin
        if self.floor is not None:
            fields["floor"] = _floor("floor", self.floor)
        if len(self.patches):
            fields["patches"] = [_floor(f"patches[{i}]", patch) for i, patch in enumerate(self.patches)]
        if len(self.walls):
            fields["walls"] = [_wall(f"walls[{i}]", wall) for i, wall in enumerate(self.walls)]
        if len(self.lights):
            fields["lights"] = [_light(f"lights[{i}]", light) for i, light in enumerate(self.lights)]
        rays = [
            _ray(f"bodies[{index}].rays[{place}]", index, ray)
            for index, body in enumerate(bodies)
            for place, ray in enumerate(body.rays)
        ]
        if rays:
            fields["rays"] = rays
        if len(self.links):
            fields["links"] = [_link(f"links[{i}]", link, len(bodies)) for i, link in enumerate(self.links)]
        if len(self.styles):
            fields["styles"] = [_style(f"styles[{i}]", style) for i, style in enumerate(self.styles)]
        if self.scale is not None:
            low, high = _number("scale.low", self.scale.low), _number("scale.high", self.scale.high)
            if low >= high:
                raise ValueError(f"scale: from {low:g} to {high:g}, expected low to be less than high")
            fields["scale"] = {"name": _text("scale.name", self.scale.name), "low": low, "high": high}
        return fields

    def of_kind(self, *kinds: str) -> list[Body]:
        """The bodies of these kinds, in their order."""
        return [body for body in self.bodies if body.kind in kinds]


def _pair(numbers: Sequence[float]) -> tuple[float, float]:
    x, y = numbers
    return x, y


def _patch(fields: PatchFields) -> Patch:
    return Patch(fields["grey"], tuple((x, y) for x, y in fields["points"]), fields["radius"], fields["name"])


def _plain(place: str, body: Any) -> BodyFields:  # noqa: ANN401 - whatever the code of a simulation says
    if not isinstance(body, Body):
        raise TypeError(f"{place}: {body!r} found, expected a swarmwright.display.Body")
    fields: BodyFields = {
        "kind": _text(f"{place}.kind", body.kind),
        "x": _number(f"{place}.x", body.x),
        "y": _number(f"{place}.y", body.y),
        "state": _text(f"{place}.state", body.state),
        "radius": _number(f"{place}.radius", body.radius, least=0.0),
    }
    if not body.kind:
        raise ValueError(f"{place}.kind: it is empty, expected a name such as agent")
    if body.heading is not None:
        fields["heading"] = _number(f"{place}.heading", body.heading)
    if body.value is not None:
        fields["value"] = _number(f"{place}.value", body.value)
    if body.label:
        fields["label"] = _text(f"{place}.label", body.label)
    if body.agent is not None:
        fields["agent"] = _index(f"{place}.agent", body.agent)
    return fields


def _floor(place: str, floor: Any) -> PatchFields:  # noqa: ANN401 - see `_plain`
    patch = floor if isinstance(floor, Patch) else Patch(floor)
    grey = _number(place if patch is not floor else f"{place}.grey", patch.grey, least=0.0, most=1.0)
    points = _points(f"{place}.points", patch.points)
    if len(points) == 2 or (not points and not place.startswith("floor")):
        found = "2 points" if points else "no points"
        raise ValueError(f"{place}.points: {found} found, expected one (a circle) or at least three")
    radius = _number(f"{place}.radius", patch.radius, least=0.0)
    return {"grey": grey, "points": points, "radius": radius, "name": _text(f"{place}.name", patch.name)}


def _wall(place: str, wall: Any) -> "WallFields":  # noqa: ANN401 - see `_plain`
    if not isinstance(wall, Wall):
        raise TypeError(f"{place}: {wall!r} found, expected a swarmwright.display.Wall")
    points = _points(f"{place}.points", wall.points)
    least = 3 if wall.solid else 2
    if len(points) < least:
        raise ValueError(f"{place}.points: {len(points)} found, expected at least {least}")
    return {"points": points, "solid": bool(wall.solid)}


def _light(place: str, light: Any) -> "LightFields":  # noqa: ANN401 - see `_plain`
    if not isinstance(light, Light):
        raise TypeError(f"{place}: {light!r} found, expected a swarmwright.display.Light")
    return {
        "x": _number(f"{place}.x", light.x),
        "y": _number(f"{place}.y", light.y),
        "intensity": _number(f"{place}.intensity", light.intensity, least=0.0),
    }


def _ray(place: str, body: int, ray: Any) -> RayFields:  # noqa: ANN401 - see `_plain`
    if not isinstance(ray, Ray):
        raise TypeError(f"{place}: {ray!r} found, expected a swarmwright.display.Ray")
    fields: RayFields = {
        "body": body,
        "angle": _number(f"{place}.angle", ray.angle),
        "start": _number(f"{place}.start", ray.start, least=0.0),
        "length": _number(f"{place}.length", ray.length, least=0.0),
    }
    if ray.reading is not None:
        fields["reading"] = _number(f"{place}.reading", ray.reading, least=0.0, most=1.0)
    return fields


def _link(place: str, link: Any, bodies: int) -> list[int]:  # noqa: ANN401 - see `_plain`
    try:
        first, second = (_index(place, end) for end in link)
    except ValueError as error:
        raise ValueError(f"{place}: {link!r} found, expected two indices of bodies") from error
    if max(first, second) >= bodies:
        raise ValueError(f"{place}: {link!r} found, but there are {bodies} bodies, from 0 to {bodies - 1}")
    return [first, second]


def _style(place: str, style: Any) -> StyleFields:  # noqa: ANN401 - see `_plain`
    if not isinstance(style, Style):
        raise TypeError(f"{place}: {style!r} found, expected a swarmwright.display.Style")
    if _text(f"{place}.color", style.color) and not re.fullmatch(r"#[0-9A-Fa-f]{6}", style.color):
        raise ValueError(f'{place}.color: {style.color!r} found, expected "#rrggbb" such as "#0072b2"')
    if style.shape and style.shape not in STYLE_SHAPES:
        raise ValueError(f"{place}.shape: {style.shape!r} found, expected one of {', '.join(STYLE_SHAPES)}")
    return {
        "kind": _text(f"{place}.kind", style.kind),
        "state": _text(f"{place}.state", style.state),
        "color": style.color,
        "shape": style.shape,
    }


def _points(place: str, points: Any) -> list[list[float]]:  # noqa: ANN401 - see `_plain`
    return [_point(f"{place}[{index}]", point) for index, point in enumerate(points)]


def _point(place: str, point: Any) -> list[float]:  # noqa: ANN401 - see `_plain`
    try:
        x, y = point
    except (TypeError, ValueError):
        raise ValueError(f"{place}: {point!r} found, expected x and y") from None
    return [_number(f"{place}[0]", x), _number(f"{place}[1]", y)]


def _text(place: str, value: Any) -> str:  # noqa: ANN401 - see `_plain`
    if not isinstance(value, str):
        raise TypeError(f"{place}: {value!r} found, expected text")
    return value


def _index(place: str, value: Any) -> int:  # noqa: ANN401 - see `_plain`
    try:
        index = value.__index__()
    except AttributeError:
        raise ValueError(f"{place}: {value!r} found, expected a whole number") from None
    if index < 0:
        raise ValueError(f"{place}: {index} found, expected at least 0")
    return int(index)


def _number(
    place: str,
    value: Any,  # noqa: ANN401 - see `_plain`
    *,
    least: float | None = None,
    most: float | None = None,
) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{place}: {value!r} found, expected a number") from None
    if isinstance(value, str):
        raise TypeError(f"{place}: the text {value!r} found, expected a number")
    if not math.isfinite(number):
        raise ValueError(f"{place}: {value} found, expected a finite number")
    if (least is not None and number < least) or (most is not None and number > most):
        limits = f"from {least:g} to {most:g}" if most is not None else f"at least {least:g}"
        raise ValueError(f"{place}: {number:g} found, expected {limits}")
    return number
