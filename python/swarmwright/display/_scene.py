"""The scene of a simulation at one step."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.engine_types import (
    BodyFields,
    PatchFields,
    RayFields,
    SceneFields,
    StyleFields,
)

if TYPE_CHECKING:
    from swarmwright.common.engine_types import BodyArrays, LightFields, RayArrays, SceneArrays, WallFields

Point = tuple[float, float]
"""x and y, in the scene's unit."""

STYLE_SHAPES = ("circle", "cross", "triangle", "star", "square", "diamond", "pentagon", "hexagon")
"""Shapes of styles."""


@dataclass(frozen=True)
class Ray:
    """The line of sight of a body's sensor.

    angle: from the body's heading, radians counter-clockwise. start: distance of its beginning from the
    middle of the body. length: from its beginning, in the scene's unit. reading: reading of the sensor, 0 to
    1.
    """

    angle: float
    length: float
    start: float = 0.0
    reading: float | None = None


@dataclass(frozen=True)
class Body:
    """An object or agent in a scene.

    kind: agent, defender, goal, exit, blockade, obstacle, ... state: free, arrived, caught, crashed, out, or
    empty. x, y, radius: in the scene's unit, metres or cells; y points up; radius 0 is a point. heading:
    radians counter-clockwise from the x axis; bodies with a heading are drawn in true size (with radius 0, as
    large as markers), those of the kind wall as lines, one radius to both sides. A body of the kind led is
    drawn on top of others, and only if it has a state, so that LEDs can be on and off. value: a number that
    determines its colour, see `Scale`. label: a short text beside it. agent: index of the agent; bodies of
    the kind agent without an index are numbered in order.
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

    grey: 0 black to 1 white. points: corners in order. name: its name in legends.
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
    """A line from point to point, or with `solid`, a filled polygon with these corners."""

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

    color: "#rrggbb", or empty for the default; it is lightened on dark pages if needed. shape: circle, cross,
    triangle, star, square, diamond, pentagon, hexagon, or empty. A style without a state applies to all
    states of the kind that have no style.
    """

    kind: str
    state: str = ""
    color: str = ""
    shape: str = ""


@dataclass(frozen=True)
class Scale:
    """The scale of the bodies' values: a name with the unit, and the values of the first and last colour."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Scene:
    """A two-dimensional world at one step; positions are from its bottom left corner.

    width, height: its extent in metres or cells. message: a line to show above. bodies: from bottom to top; a
    list of `Body`, or `Bodies` for thousands. grid: whether it consists of cells, which are numbered from (0,
    0) at the top left.

    floor: its colour, 0 black to 1 white, or a patch if it does not fill the world. patches: coloured parts
    of the floor, from bottom to top, clipped to the floor. walls, lights: walls and lamps. links: pairs of
    indices of bodies, of which the second hears the first. styles: looks defined by the simulation. scale:
    scale of the bodies' values; default: from the smallest to the largest.

    origin: coordinates of the bottom left corner in the simulation, (x, y), for the axes.
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
    def from_fields(cls, fields: SceneFields) -> Self:
        """Create a scene from the engine's fields."""
        rays: dict[int, list[Ray]] = {}
        for ray in fields.get("rays", []):
            rays.setdefault(ray["body"], []).append(
                Ray(ray["angle"], ray["length"], ray["start"], ray.get("reading"))
            )
        bodies = tuple(
            Body(**body, rays=tuple(rays.get(index, ()))) for index, body in enumerate(fields["bodies"])
        )
        return cls.from_parts(fields, bodies, [(first, second) for first, second in fields.get("links", [])])

    @classmethod
    def from_parts(
        cls, fields: SceneFields, bodies: Sequence[Body], links: Sequence[tuple[int, int]]
    ) -> Self:
        """Create a scene from bodies and links, and the engine's other fields."""
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

    def with_bodies(self, step: int, bodies: Sequence[Body], links: Sequence[tuple[int, int]]) -> Self:
        """Return the scene at another step, with the same surroundings: faster than `dataclasses.replace`."""
        scene = object.__new__(type(self))
        scene.__dict__.update(self.__dict__, step=step, bodies=bodies, links=links)
        return scene

    def plain(self) -> SceneFields:
        """Convert to the engine's fields. Raises ValueError or TypeError for invalid values."""
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
            _ray(f"bodies[{index}].rays[{number}]", index, ray)
            for index, body in enumerate(bodies)
            for number, ray in enumerate(body.rays)
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

    def find_bodies(self, *kinds: str) -> list[Body]:
        """Return the bodies of these kinds, in order."""
        return [body for body in self.bodies if body.kind in kinds]


def _pair(numbers: Sequence[float]) -> tuple[float, float]:
    x, y = numbers
    return x, y


def _patch(fields: PatchFields) -> Patch:
    return Patch(fields["grey"], tuple((x, y) for x, y in fields["points"]), fields["radius"], fields["name"])


def _plain(field: str, body: Any) -> BodyFields:  # noqa: ANN401 - from user code
    if not isinstance(body, Body):
        raise TypeError(f"{field}: {body!r} found, expected a swarmwright.display.Body")
    fields: BodyFields = {
        "kind": _text(f"{field}.kind", body.kind),
        "x": _number(f"{field}.x", body.x),
        "y": _number(f"{field}.y", body.y),
        "state": _text(f"{field}.state", body.state),
        "radius": _number(f"{field}.radius", body.radius, least=0.0),
    }
    if not body.kind:
        raise ValueError(f"{field}.kind: is empty, expected a name such as agent")
    if body.heading is not None:
        fields["heading"] = _number(f"{field}.heading", body.heading)
    if body.value is not None:
        fields["value"] = _number(f"{field}.value", body.value)
    if body.label:
        fields["label"] = _text(f"{field}.label", body.label)
    if body.agent is not None:
        fields["agent"] = _index(f"{field}.agent", body.agent)
    return fields


def _floor(field: str, floor: Any) -> PatchFields:  # noqa: ANN401 - see `_plain`
    patch = floor if isinstance(floor, Patch) else Patch(floor)
    grey = _number(field if patch is not floor else f"{field}.grey", patch.grey, least=0.0, most=1.0)
    points = _points(f"{field}.points", patch.points)
    if len(points) == 2 or (not points and not field.startswith("floor")):
        count = "2 points" if points else "no points"
        raise ValueError(f"{field}.points: {count} found, expected one (a circle) or at least three")
    radius = _number(f"{field}.radius", patch.radius, least=0.0)
    return {"grey": grey, "points": points, "radius": radius, "name": _text(f"{field}.name", patch.name)}


def _wall(field: str, wall: Any) -> "WallFields":  # noqa: ANN401 - see `_plain`
    if not isinstance(wall, Wall):
        raise TypeError(f"{field}: {wall!r} found, expected a swarmwright.display.Wall")
    points = _points(f"{field}.points", wall.points)
    least = 3 if wall.solid else 2
    if len(points) < least:
        raise ValueError(f"{field}.points: {len(points)} found, expected at least {least}")
    return {"points": points, "solid": bool(wall.solid)}


def _light(field: str, light: Any) -> "LightFields":  # noqa: ANN401 - see `_plain`
    if not isinstance(light, Light):
        raise TypeError(f"{field}: {light!r} found, expected a swarmwright.display.Light")
    return {
        "x": _number(f"{field}.x", light.x),
        "y": _number(f"{field}.y", light.y),
        "intensity": _number(f"{field}.intensity", light.intensity, least=0.0),
    }


def _ray(field: str, body: int, ray: Any) -> RayFields:  # noqa: ANN401 - see `_plain`
    if not isinstance(ray, Ray):
        raise TypeError(f"{field}: {ray!r} found, expected a swarmwright.display.Ray")
    fields: RayFields = {
        "body": body,
        "angle": _number(f"{field}.angle", ray.angle),
        "start": _number(f"{field}.start", ray.start, least=0.0),
        "length": _number(f"{field}.length", ray.length, least=0.0),
    }
    if ray.reading is not None:
        fields["reading"] = _number(f"{field}.reading", ray.reading, least=0.0, most=1.0)
    return fields


def _link(field: str, link: Any, bodies: int) -> list[int]:  # noqa: ANN401 - see `_plain`
    try:
        first, second = (_index(field, end) for end in link)
    except ValueError as error:
        raise ValueError(f"{field}: {link!r} found, expected two indices of bodies") from error
    if max(first, second) >= bodies:
        raise ValueError(
            f"{field}: {link!r} found, expected indices of the {bodies} bodies, 0 to {bodies - 1}"
        )
    return [first, second]


def _style(field: str, style: Any) -> StyleFields:  # noqa: ANN401 - see `_plain`
    if not isinstance(style, Style):
        raise TypeError(f"{field}: {style!r} found, expected a swarmwright.display.Style")
    if _text(f"{field}.color", style.color) and not re.fullmatch(r"#[0-9A-Fa-f]{6}", style.color):
        raise ValueError(f'{field}.color: {style.color!r} found, expected "#rrggbb" such as "#0072b2"')
    if style.shape and style.shape not in STYLE_SHAPES:
        raise ValueError(f"{field}.shape: {style.shape!r} found, expected one of {', '.join(STYLE_SHAPES)}")
    return {
        "kind": _text(f"{field}.kind", style.kind),
        "state": _text(f"{field}.state", style.state),
        "color": style.color,
        "shape": style.shape,
    }


def _points(field: str, points: Any) -> list[list[float]]:  # noqa: ANN401 - see `_plain`
    return [_point(f"{field}[{index}]", point) for index, point in enumerate(points)]


def _point(field: str, point: Any) -> list[float]:  # noqa: ANN401 - see `_plain`
    try:
        x, y = point
    except (TypeError, ValueError):
        raise ValueError(f"{field}: {point!r} found, expected x and y") from None
    return [_number(f"{field}[0]", x), _number(f"{field}[1]", y)]


def _text(field: str, value: Any) -> str:  # noqa: ANN401 - see `_plain`
    if not isinstance(value, str):
        raise TypeError(f"{field}: {value!r} found, expected text")
    return value


def _index(field: str, value: Any) -> int:  # noqa: ANN401 - see `_plain`
    try:
        index = value.__index__()
    except AttributeError:
        raise ValueError(f"{field}: {value!r} found, expected a whole number") from None
    if index < 0:
        raise ValueError(f"{field}: {index} found, expected at least 0")
    return int(index)


def _number(
    field: str,
    value: Any,  # noqa: ANN401 - see `_plain`
    *,
    least: float | None = None,
    most: float | None = None,
) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{field}: {value!r} found, expected a number") from None
    if isinstance(value, str):
        raise TypeError(f"{field}: the text {value!r} found, expected a number")
    if not math.isfinite(number):
        raise ValueError(f"{field}: {value} found, expected a finite number")
    if (least is not None and number < least) or (most is not None and number > most):
        limits = f"from {least:g} to {most:g}" if most is not None else f"at least {least:g}"
        raise ValueError(f"{field}: {number:g} found, expected {limits}")
    return number


Numbers = NDArray[np.float32]


class Bodies(Sequence[Body]):
    """Bodies as arrays: a sequence of `Body` without an object for each.

    Args:
        x: (bodies,), in the scene's unit, like y and radius.
        y: (bodies,)
        kind: kind of all bodies, or one for each.
        state: state of all bodies, or one for each.
        radius: radius of all bodies, or (bodies,).
        heading: (bodies,), radians counter-clockwise from the x axis; NaN or None: no heading.
        value: (bodies,), numbers that determine colours; NaN or None: no value.
        labels: a text for each body, or None.
        agent: (bodies,), index of the agent; -1 if not given.

    Raises ValueError when arrays have different lengths.

    """

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        kind: str | Sequence[str] = "agent",
        state: str | Sequence[str] = "",
        radius: ArrayLike = 0.0,
        heading: ArrayLike | None = None,
        value: ArrayLike | None = None,
        labels: Sequence[str] | None = None,
        agent: ArrayLike | None = None,
    ) -> None:
        self.x = np.asarray(x, dtype=np.float32)
        if self.x.ndim != 1:
            raise ValueError(f"x: an array of the shape {self.x.shape} found, expected (bodies,)")
        count = len(self.x)
        self.y = _numbers("y", y, count)
        self.radius = _numbers("radius", radius, count)
        self.heading = _numbers("heading", np.nan if heading is None else heading, count)
        self.value = _numbers("value", np.nan if value is None else value, count)
        self.agent = np.full(count, -1) if agent is None else np.asarray(agent, dtype=np.int64)
        kinds = [kind] * count if isinstance(kind, str) else list(kind)
        states = [state] * count if isinstance(state, str) else list(state)
        for name, values in (("kind", kinds), ("state", states), ("agent", self.agent), ("labels", labels)):
            if values is not None and len(values) != count:
                raise ValueError(f"{name}: {len(values)} found, expected {count}, one for each body")
        self.labels = None if labels is None else list(labels)
        index: dict[tuple[str, str], int] = {}
        self.look = np.array(
            [index.setdefault(look, len(index)) for look in zip(kinds, states, strict=True)], dtype=np.uint16
        )
        self.looks = list(index)
        self.ray_body: NDArray[np.uint32] = np.empty(0, np.uint32)
        self.ray_numbers: Numbers = np.empty((0, 4), np.float32)

    @classmethod
    def from_bodies(cls, bodies: Sequence[Body]) -> "Bodies":
        """Convert bodies to arrays."""
        if isinstance(bodies, Bodies):
            return bodies
        arrays = cls(
            [body.x for body in bodies],
            [body.y for body in bodies],
            [body.kind for body in bodies],
            [body.state for body in bodies],
            [body.radius for body in bodies],
            [np.nan if body.heading is None else body.heading for body in bodies],
            [np.nan if body.value is None else body.value for body in bodies],
            [body.label for body in bodies] if any(body.label for body in bodies) else None,
            [-1 if body.agent is None else body.agent for body in bodies],
        )
        rays = [(index, ray) for index, body in enumerate(bodies) for ray in body.rays]
        arrays.ray_body = np.array([index for index, _ in rays], dtype=np.uint32)
        numbers = [
            (ray.angle, ray.start, ray.length, np.nan if ray.reading is None else ray.reading)
            for _, ray in rays
        ]
        arrays.ray_numbers = np.array(numbers, dtype=np.float32).reshape(-1, 4)
        return arrays

    @classmethod
    def from_arrays(cls, bodies: "BodyArrays", rays: "RayArrays") -> Self:
        """Wrap the engine's arrays."""
        instance = cls.__new__(cls)
        instance.x, instance.y, instance.radius = bodies["x"], bodies["y"], bodies["radius"]
        instance.heading, instance.value, instance.agent = bodies["heading"], bodies["value"], bodies["agent"]
        instance.looks, instance.look, instance.labels = bodies["looks"], bodies["look"], bodies["labels"]
        instance.ray_body, instance.ray_numbers = rays["body"], rays["numbers"]
        return instance

    def with_positions(self, x: Numbers, y: Numbers, heading: Numbers) -> "Bodies":
        """Return a copy at other positions."""
        copy = type(self).__new__(type(self))
        copy.__dict__.update(self.__dict__)
        copy.x, copy.y, copy.heading = x, y, heading
        return copy

    def has(self, *kinds: str) -> NDArray[np.bool_]:
        """Return which bodies are of these kinds, (bodies,)."""
        is_kind = np.array([kind in kinds for kind, _ in self.looks], dtype=bool)
        return is_kind[self.look] if len(is_kind) else np.zeros(0, dtype=bool)

    def agents(self) -> NDArray[np.int64]:
        """Return the agent index of each body, (bodies,), -1 for bodies that are not agents."""
        if (self.agent >= 0).any():
            return self.agent
        is_agent = self.has("agent")
        return np.where(is_agent, np.cumsum(is_agent) - 1, -1)

    def __len__(self) -> int:
        return len(self.x)

    @overload
    def __getitem__(self, index: int) -> Body: ...
    @overload
    def __getitem__(self, index: slice) -> list[Body]: ...
    def __getitem__(self, index: int | slice) -> Body | list[Body]:
        if isinstance(index, slice):
            return [self[item] for item in range(*index.indices(len(self)))]
        position = range(len(self))[index]
        kind, state = self.looks[self.look[position]]
        rays = tuple(
            Ray(float(angle), float(length), float(start), _number_or_none(reading))
            for angle, start, length, reading in self.ray_numbers[self.ray_body == position]
        )
        agent = int(self.agent[position])
        return Body(
            kind, float(self.x[position]), float(self.y[position]), state, float(self.radius[position]),
            _number_or_none(self.heading[position]), _number_or_none(self.value[position]),
            self.labels[position] if self.labels else "", agent if agent >= 0 else None, rays,
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or len(self) != len(other):
            return NotImplemented
        return all(first == second for first, second in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment] # arrays can change

    def __repr__(self) -> str:
        names = ", ".join(f"{kind}, {state}" if state else kind for kind, state in self.looks)
        return f"Bodies({len(self)} of {names})" if names else "Bodies(0)"


def scene_from_arrays(arrays: "SceneArrays") -> Scene:
    """Convert the engine's arrays to a scene."""
    links = arrays["links"]
    bodies = Bodies.from_arrays(arrays["bodies"], arrays["rays"])
    return Scene.from_parts(arrays["scene"], bodies, links)  # type: ignore[arg-type] # rows are pairs


def _numbers(name: str, value: Any, count: int) -> Numbers:  # noqa: ANN401 - an array or a number
    numbers = np.asarray(value, dtype=np.float32)
    if numbers.ndim > 1 or (numbers.ndim == 1 and len(numbers) != count):
        raise ValueError(f"{name}: an array of the shape {numbers.shape} found, expected ({count},)")
    return numbers if numbers.ndim else np.full(count, numbers, dtype=np.float32)


def _number_or_none(number: Any) -> float | None:  # noqa: ANN401 - of an array
    return None if np.isnan(number) else float(number)
