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
    """Bodies as arrays: a sequence of `Body` that does not keep an object for each.

    Args:
        x: (bodies,), in the scene's unit, as y and radius.
        y: (bodies,)
        kind: of all, or one for each.
        state: of all, or one for each.
        radius: of all, or (bodies,).
        heading: (bodies,), radians counter-clockwise from the x axis; NaN or None where there is none.
        value: (bodies,), numbers that give colours; NaN or None where there is none.
        labels: a text for each, or None.
        agent: (bodies,), which agent each is; -1 where it does not say.

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
        for name, given in (("kind", kinds), ("state", states), ("agent", self.agent), ("labels", labels)):
            if given is not None and len(given) != count:
                raise ValueError(f"{name}: {len(given)} found, expected {count}, one for each body")
        self.labels = None if labels is None else list(labels)
        index: dict[tuple[str, str], int] = {}
        self.look = np.array(
            [index.setdefault(look, len(index)) for look in zip(kinds, states, strict=True)], dtype=np.uint16
        )
        self.looks = list(index)
        self.ray_body: NDArray[np.uint32] = np.empty(0, np.uint32)
        self.ray_numbers: Numbers = np.empty((0, 4), np.float32)

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> "Bodies":
        """Return bodies as arrays."""
        if isinstance(bodies, Bodies):
            return bodies
        made = cls(
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
        made.ray_body = np.array([index for index, _ in rays], dtype=np.uint32)
        numbers = [
            (ray.angle, ray.start, ray.length, np.nan if ray.reading is None else ray.reading)
            for _, ray in rays
        ]
        made.ray_numbers = np.array(numbers, dtype=np.float32).reshape(-1, 4)
        return made

    @classmethod
    def around(cls, bodies: "BodyArrays", rays: "RayArrays") -> Self:
        """Return the engine's arrays."""
        made = cls.__new__(cls)
        made.x, made.y, made.radius = bodies["x"], bodies["y"], bodies["radius"]
        made.heading, made.value, made.agent = bodies["heading"], bodies["value"], bodies["agent"]
        made.looks, made.look, made.labels = bodies["looks"], bodies["look"], bodies["labels"]
        made.ray_body, made.ray_numbers = rays["body"], rays["numbers"]
        return made

    def moved(self, x: Numbers, y: Numbers, heading: Numbers) -> "Bodies":
        """Return the same bodies elsewhere."""
        made = type(self).__new__(type(self))
        made.__dict__.update(self.__dict__)
        made.x, made.y, made.heading = x, y, heading
        return made

    def has(self, *kinds: str) -> NDArray[np.bool_]:
        """Return which are of these kinds, (bodies,)."""
        there = np.array([kind in kinds for kind, _ in self.looks], dtype=bool)
        return there[self.look] if len(there) else np.zeros(0, dtype=bool)

    def agents(self) -> NDArray[np.int64]:
        """Return which agent each is, (bodies,), -1 for what is none."""
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
            return [self[place] for place in range(*index.indices(len(self)))]
        place = range(len(self))[index]
        kind, state = self.looks[self.look[place]]
        rays = tuple(
            Ray(float(angle), float(length), float(start), _number_or_none(reading))
            for angle, start, length, reading in self.ray_numbers[self.ray_body == place]
        )
        agent = int(self.agent[place])
        return Body(
            kind, float(self.x[place]), float(self.y[place]), state, float(self.radius[place]),
            _number_or_none(self.heading[place]), _number_or_none(self.value[place]),
            self.labels[place] if self.labels else "", agent if agent >= 0 else None, rays,
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or len(self) != len(other):
            return NotImplemented
        return all(body == two for body, two in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment] # arrays can change

    def __repr__(self) -> str:
        names = ", ".join(f"{kind}, {state}" if state else kind for kind, state in self.looks)
        return f"Bodies({len(self)} of {names})" if names else "Bodies(0)"


def scene_of(arrays: "SceneArrays") -> Scene:
    """Return the engine's scene."""
    links = arrays["links"]
    bodies = Bodies.around(arrays["bodies"], arrays["rays"])
    return Scene.around(arrays["scene"], bodies, links)  # type: ignore[arg-type] # rows are pairs


def _numbers(name: str, value: Any, count: int) -> Numbers:  # noqa: ANN401 - an array or a number
    numbers = np.asarray(value, dtype=np.float32)
    if numbers.ndim > 1 or (numbers.ndim == 1 and len(numbers) != count):
        raise ValueError(f"{name}: an array of the shape {numbers.shape} found, expected ({count},)")
    return numbers if numbers.ndim else np.full(count, numbers, dtype=np.float32)


def _number_or_none(number: Any) -> float | None:  # noqa: ANN401 - of an array
    return None if np.isnan(number) else float(number)
