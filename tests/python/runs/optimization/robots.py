"""Robots that sense what machines of modules need, in a square with a light and a black floor."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import Simulation


class Robots(Simulation):
    """Five robots with two wheels; fitness: how many of their steps end on the black floor."""

    title, dimensions, sensors, actuators = "robots", 2, 9, 2
    determinism = "bitwise"

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:  # noqa: ARG002 - it has none
        """Put them at random places."""
        self.random = np.random.default_rng(seed)
        self.places = self.random.uniform(-1, 1, (5, 2))
        self.headings = self.random.uniform(-np.pi, np.pi, 5)
        self.steps, self.black = 0, 0
        return self.sensed()

    def turned(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vectors as the robots see them."""
        cos, sin = np.cos(self.headings), np.sin(self.headings)
        x, y = vectors.T
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)

    def sensed(self) -> NDArray[np.float64]:
        """All readings."""
        apart = self.places[np.newaxis] - self.places[:, np.newaxis]
        distance = np.hypot(*np.moveaxis(apart, 2, 0)) + 10 * np.eye(5)
        near = np.where(distance < 0.3, (0.3 - distance) / distance, 0.0)
        wall = np.where(np.abs(self.places) > 0.9, np.sign(self.places) * 0.8, 0.0)
        proximity = np.clip((near[..., np.newaxis] * apart).sum(axis=1) + wall, -0.7, 0.7)
        heard = distance < 0.8
        attraction = np.where(heard, 0.05 / distance**2, 0.0)
        light = np.array([0.0, 2.0]) - self.places
        light /= np.hypot(*light.T)[:, np.newaxis]
        return np.column_stack(
            [
                self.turned(proximity),
                self.turned(light),
                np.where(self.places[:, 1] > 0.3, 0.0, 0.5),
                heard.sum(axis=1),
                self.turned((attraction[..., np.newaxis] * apart).sum(axis=1)),
                self.random.integers(0, 1 << 24, 5) / (1 << 24),
            ]
        )

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Drive for a tenth of a second."""
        left, right = actions.astype(np.float64).T
        self.headings += 0.4 * (right - left)
        ahead = 0.06 * (left + right)
        self.places += ahead[:, np.newaxis] * np.stack([np.cos(self.headings), np.sin(self.headings)], axis=1)
        self.places.clip(-1, 1, out=self.places)
        self.steps += 1
        self.black += int((self.places[:, 1] > 0.3).sum())
        return self.sensed()

    def done(self) -> bool:
        """After 6 seconds."""
        return self.steps == 60

    def fitness(self) -> float:
        """Steps of robots that ended on black."""
        return float(self.black)
