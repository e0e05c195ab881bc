"""Simulators that move the robots of missions, and such as do it wrongly."""

import numpy as np

from swarmwright import InputError, Physics


class Floating(Physics):
    """Robots go where they are told, through everything."""

    determinism = "bitwise"

    def start(self, world, changed, robots, objects, seed):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN201, ARG002
        if len(robots) > 50:
            raise InputError("robots: at most 50 are possible here")
        self.tick = world.tick
        self.robots, self.objects = robots.astype(float), objects

    def step(self, motions):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN201
        ahead, left, turn = motions.T
        cos, sin = np.cos(self.robots[:, 2]), np.sin(self.robots[:, 2])
        self.robots += self.tick * np.column_stack([ahead * cos - left * sin, ahead * sin + left * cos, turn])

    def poses(self):  # type: ignore[no-untyped-def] # noqa: ANN201
        return self.robots, self.objects


class Lost(Floating):
    def poses(self):  # type: ignore[no-untyped-def] # noqa: ANN201
        self.robots[2, 1] = np.nan
        return super().poses()  # type: ignore[no-untyped-call]


class Short(Floating):
    def poses(self):  # type: ignore[no-untyped-def] # noqa: ANN201
        return self.robots[1:], self.objects


class Alone(Floating):
    def poses(self):  # type: ignore[no-untyped-def] # noqa: ANN201
        return self.robots


class Broken(Floating):
    def step(self, motions):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN201, ARG002
        return 1 / 0


class Titled(Floating):
    title = "floating"


class Unfinished(Physics):
    pass


class Sees(Floating):
    """All rays are half as long as they can be."""

    def start(self, world, changed, robots, objects, seed):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN201
        super().start(world, changed, robots, objects, seed)  # type: ignore[no-untyped-call]
        self.length = world.model(0).ray_range / 2
        self.shape = (len(robots), len(world.model(0).rays))

    def rays(self):  # type: ignore[no-untyped-def] # noqa: ANN201
        return np.full(self.shape, self.length)
