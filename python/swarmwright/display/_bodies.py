"""The bodies of a scene as arrays, for swarms of thousands."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.display._scene import Body, Ray, Scene

if TYPE_CHECKING:
    from swarmwright.common.engine_types import BodyArrays, RayArrays, SceneArrays

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
