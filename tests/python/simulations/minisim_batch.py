"""Minisim in Python for many episodes at once: the same arithmetic, with one axis more."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import BatchSimulation
from tests.python.simulations import minisim
from tests.python.simulations.minisim import F, cos_pi, sin_pi

Many = NDArray[np.float32]  # (episodes, bodies, 2)
Flags = NDArray[np.bool_]  # (episodes, agents)


def squares(these: Many, others: Many) -> NDArray[np.float32]:
    """(episodes, these, others) squared distances."""
    d = others[:, None] - these[:, :, None]
    d *= d
    found: NDArray[np.float32] = d[..., 0] + d[..., 1]
    return found


class Minisim(BatchSimulation):
    """Many episodes of `tests.python.simulations.minisim.Minisim`."""

    title = "minisim in numpy"
    sensors = 4
    actuators = 1
    max_agents = 100_000
    metrics = minisim.Minisim.metrics
    parameters = minisim.Minisim.parameters
    lanes = 64

    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> Many:
        self.map = np.array([parameters["mapWidth"], parameters["mapHeight"]], F)
        self.goal = np.array([self.map[0] - F(0.5), self.map[1] / F(2)], F)
        self.speeds = F(parameters["speedAgents"]), F(parameters["speedDefenders"])
        self.radii = F(parameters["goalRadius"]), F(parameters["captureRadius"])
        self.left = parameters["maxSteps"]
        third = self.map[0] / F(3)

        def place(stream: int, count: int) -> Many:
            drawn = [
                [minisim.uniform(int(seed), stream, index) for index in range(2 * count)] for seed in seeds
            ]
            return np.array(drawn, F).reshape(-1, count, 2) * np.array([third, self.map[1]], F)

        self.agents = place(0, parameters["numAgents"])
        self.defenders = place(1, parameters["numDefenders"])
        self.defenders[:, :, 0] += third
        self.free = np.full(self.agents.shape[:2], True)
        self.arrived = ~self.free
        self.steps = np.zeros(len(seeds))
        return self.sense()

    def sense(self) -> Many:
        seen = np.zeros((*self.agents.shape[:2], 4), F)
        seen[..., :2] = (self.goal - self.agents) / self.map
        if self.defenders.shape[1]:
            closest = squares(self.agents, self.defenders).argmin(axis=2)
            found = np.take_along_axis(self.defenders, closest[:, :, None], axis=1)
            seen[..., 2:] = (found - self.agents) / self.map
        return seen

    def step(self, actions: Many) -> Many:
        free = self.free.copy()
        going = ~self.done()
        heading = np.stack([cos_pi(actions[..., 0]), sin_pi(actions[..., 0])], axis=2)
        moved = np.clip(self.agents + self.speeds[0] * heading, F(0), self.map)
        self.agents = np.where(free[:, :, None], moved, self.agents)
        for index in range(self.defenders.shape[1]):
            self.chase(index, free, going)
        to_goal = np.sqrt(squares(self.agents, np.broadcast_to(self.goal, (len(free), 1, 2)))[..., 0])
        self.arrived |= free & (to_goal <= self.radii[0])
        self.free = free & ~self.arrived
        if self.defenders.shape[1]:
            self.free &= np.sqrt(squares(self.agents, self.defenders).min(axis=2)) > self.radii[1]
        self.left -= 1
        self.steps += going
        return self.sense()

    def chase(self, index: int, free: Flags, going: NDArray[np.bool_]) -> None:
        defender = self.defenders[:, index]
        q = np.where(free, squares(defender[:, None], self.agents)[:, 0], F(np.inf))
        closest = q.argmin(axis=1)
        d = np.sqrt(q[np.arange(len(q)), closest])
        target = self.agents[np.arange(len(q)), closest]
        with np.errstate(divide="ignore", invalid="ignore"):
            towards = defender + (target - defender) * (self.speeds[1] / d)[:, None]
        moved = np.where((d <= self.speeds[1])[:, None], target, towards)
        self.defenders[:, index] = np.where(going[:, None], moved, defender)

    def acting(self) -> Flags:
        return self.free

    def measure(self) -> dict[str, Any]:
        caught = ~self.free & ~self.arrived
        counts = {"arrived": self.arrived.sum(axis=1), "caught": caught.sum(axis=1)}
        return {**counts, "steps": self.steps, "distance": -self.fitness()}

    def done(self) -> NDArray[np.bool_]:
        return np.full(len(self.free), self.left == 0) | ~self.free.any(axis=1)

    def fitness(self) -> NDArray[np.float64]:
        to_goal = np.sqrt(squares(self.agents, np.broadcast_to(self.goal, (len(self.free), 1, 2)))[..., 0])
        total = np.zeros(len(self.free))
        for agent in range(self.agents.shape[1]):  # in this order, as in the engine
            total += np.where(self.arrived[:, agent], 0.0, to_goal[:, agent].astype(float))
        found: NDArray[np.float64] = 0.0 - total / self.agents.shape[1]
        return found
