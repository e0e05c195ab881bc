"""The arena: a floor with walls around it and obstacles on it, and free places for robots.

x and y are 0 in the middle of the arena; metres.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError

Points = NDArray[np.float64]  # (n, 2)

WALL = 0.05
"""Half the thickness of a wall."""
_KEYS = {"width", "depth", "height", "pillars"}
_TRIED_PLACES = 10_000
"""Places that are tried for a body before it is said that there is none."""


@dataclass(frozen=True)
class Arena:
    """A rectangle with round pillars in it.

    width, depth, height: in x, y and z. pillars: (x, y, radius) of each that is always at the same place.
    """

    width: float
    depth: float
    height: float
    pillars: tuple[tuple[float, float, float], ...]

    @classmethod
    def read(cls, raw: Mapping[str, Any]) -> Self:
        """Check the parameter `arena`. Raises InputError, "arena: why"."""
        unknown = sorted(set(raw) - _KEYS)
        if unknown:
            raise InputError(f"arena: {unknown[0]!r} found, expected {', '.join(sorted(_KEYS))}")
        width, depth, height = (
            _length(raw.get(name, default), f"arena: {name}", 0.5, 100)
            for name, default in (("width", 6), ("depth", 6), ("height", 3))
        )
        pillars = raw.get("pillars", ())
        if not isinstance(pillars, list | tuple):
            raise InputError(f"arena: pillars: {pillars!r} found, expected a list of [x, y, radius]")
        return cls(width, depth, height, tuple(_pillar(one, (width, depth)) for one in pillars))

    def xml(self, more: int, radius: float) -> str:
        """Return the static bodies of a MuJoCo model.

        more: additional pillars, anywhere. radius: of these.
        """
        x, y, z = self.width / 2, self.depth / 2, self.height / 2
        long = y + 2 * WALL
        walls = [(x + WALL, 0.0, WALL, long), (-x - WALL, 0.0, WALL, long)]
        walls += [(0.0, y + WALL, x, WALL), (0.0, -y - WALL, x, WALL)]
        radii = [one[2] for one in self.pillars] + [radius] * more
        return "\n".join(
            [
                '<light pos="0 0 9" dir="0.1 0.15 -1" diffuse="0.45 0.45 0.45" directional="true"/>',
                f'<geom name="floor" type="plane" size="{x + 1} {y + 1} 1" material="floor" group="1"/>',
                *(
                    f'<geom name="wall{i}" type="box" pos="{a} {b} {z}" size="{c} {d} {z}" material="wall"/>'
                    for i, (a, b, c, d) in enumerate(walls)
                ),
                *(
                    f'<body name="pillar{i}" mocap="true"><geom name="pillar{i}" type="cylinder" '
                    f'size="{one} {z}" material="pillar"/></body>'
                    for i, one in enumerate(radii)
                ),
            ]
        )

    def place(
        self, random: np.random.Generator, more: int, radius: float, robots: int, size: float, spread: float
    ) -> tuple[Points, Points]:
        """Return places of all pillars and of robots that are free, at random.

        Args:
            random: the random number generator.
            more: additional pillars.
            radius: of these.
            robots: how many.
            size: free radius around the middle of each robot.
            spread: robots are placed within this share of the arena's sides, around the middle.

        Raises InputError where there is not enough space.
        """
        taken = [(x, y, r) for x, y, r in self.pillars]
        half = np.array([self.width, self.depth]) / 2

        def found(count: int, clearance: float, share: float, name: str) -> Points:
            places: list[tuple[float, float]] = []
            for _ in range(_TRIED_PLACES):
                if len(places) == count:
                    break
                x, y = random.uniform(-1, 1, 2) * (half * share - clearance)
                if all((x - a) ** 2 + (y - b) ** 2 > (clearance + r) ** 2 for a, b, r in taken):
                    places.append((x, y))
                    taken.append((x, y, clearance))
            if len(places) < count:
                raise InputError(f"{name}: the arena is too small for {count} of them")
            return np.array(places).reshape(count, 2)

        if min(half) * spread <= size:
            raise InputError("arena: too small for robots")
        pillars = found(more, radius, 1.0, "pillars")
        robots_at = found(robots, size, spread, "agents")
        fixed = np.array([(x, y) for x, y, _ in self.pillars]).reshape(-1, 2)
        return np.vstack([fixed, pillars]), robots_at


def _length(value: Any, name: str, least: float, most: float) -> float:  # noqa: ANN401 - any JSON value
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise InputError(f"{name}: {value!r} found, expected metres, from {least} to {most}")
    return float(value)


def _pillar(raw: Any, sizes: tuple[float, float]) -> tuple[float, float, float]:  # noqa: ANN401 - any JSON value
    fits = isinstance(raw, list | tuple) and len(raw) == 3
    if not fits or not all(isinstance(v, int | float) and math.isfinite(v) for v in raw) or raw[2] <= 0:
        raise InputError(f"arena: pillars: {raw!r} found, expected [x, y, radius] in metres")
    x, y, radius = (float(v) for v in raw)
    if abs(x) > sizes[0] / 2 or abs(y) > sizes[1] / 2:
        raise InputError(f"arena: pillars: {raw!r} is outside; (0, 0) is the middle of the arena")
    return x, y, radius
