"""Minisim once more, in Python: the arithmetic of engine/worlds/worlds/src/minisim, operation by operation,
in binary32."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import Parameter, Simulation

F = np.float32
Points = NDArray[np.float32]  # (bodies, 2)

SIN = [F(c) for c in (3.1415927, -5.167707, 2.5500288, -0.59804523, 0.077220164)]
WORD = 2**64 - 1


def sin_pi_half(r: Points) -> Points:
    """Sine of pi * r, -0.5 to 0.5, as in decision 002."""
    z = r * r
    p = (((SIN[4] * z + SIN[3]) * z + SIN[2]) * z + SIN[1]) * z + SIN[0]
    limited: Points = np.clip(r * p, F(-1), F(1))
    return limited


def sin_pi(a: Points) -> Points:
    r = np.where(a > F(0.5), F(1) - a, a)
    return sin_pi_half(np.where(r < F(-0.5), F(-1) - r, r))


def cos_pi(a: Points) -> Points:
    return sin_pi_half(F(0.5) - np.abs(a))


def splitmix(x: int) -> int:
    z = (x + 0x9E37_79B9_7F4A_7C15) & WORD
    z = ((z ^ (z >> 30)) * 0xBF58_476D_1CE4_E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D0_49BB_1331_11EB) & WORD
    return z ^ (z >> 31)


def uniform(seed: int, stream: int, index: int) -> np.float32:
    return F(splitmix(splitmix(splitmix(seed) ^ stream) ^ index) >> 40) / F(16_777_216)


def squares(these: Points, others: Points) -> Points:
    """(these, others) squared distances."""
    d = others[None] - these[:, None]
    d *= d
    found: Points = d[..., 0] + d[..., 1]
    return found


class Minisim(Simulation):
    """The simulation with random placement; titled so that nobody takes it for the engine's."""

    title = "minisim in Python"
    sensors = 4
    actuators = 1
    max_agents = 100_000
    metrics = ("arrived", "caught", "steps", "distance")
    parameters = {  # noqa: RUF012 - as users write it
        "mapWidth": Parameter(13, "Metres.", minimum=1),
        "mapHeight": Parameter(7, "Metres.", minimum=1),
        "numAgents": Parameter(1, minimum=1),
        "numDefenders": Parameter(1, minimum=0),
        "speedAgents": Parameter(1.0, "Metres per step.", minimum=0),
        "speedDefenders": Parameter(0.33, "Metres per step.", minimum=0),
        "maxSteps": Parameter(15, minimum=1),
        "captureRadius": 0.5,
        "goalRadius": 0.5,
        "placement": Parameter("random", choices=["random"]),
    }

    def reset(self, parameters: dict[str, Any], seed: int) -> Points:
        self.map = np.array([parameters["mapWidth"], parameters["mapHeight"]], F)
        self.goal = np.array([self.map[0] - F(0.5), self.map[1] / F(2)], F)
        self.speeds = F(parameters["speedAgents"]), F(parameters["speedDefenders"])
        self.radii = F(parameters["goalRadius"]), F(parameters["captureRadius"])
        self.left = self.steps = parameters["maxSteps"]
        third = self.map[0] / F(3)

        def place(stream: int, count: int) -> Points:
            drawn = [uniform(seed, stream, index) for index in range(2 * count)]
            return np.array(drawn, F).reshape(count, 2) * np.array([third, self.map[1]], F)

        self.agents = place(0, parameters["numAgents"])
        self.defenders = place(1, parameters["numDefenders"])
        self.defenders[:, 0] += third
        self.free = np.full(len(self.agents), True)
        self.arrived = ~self.free
        return self.sense()

    def sense(self) -> Points:
        seen = np.zeros((len(self.agents), 4), F)
        seen[:, :2] = (self.goal - self.agents) / self.map
        if len(self.defenders):
            closest = squares(self.agents, self.defenders).argmin(axis=1)
            seen[:, 2:] = (self.defenders[closest] - self.agents) / self.map
        return seen

    def step(self, actions: Points) -> Points:
        free = self.free
        heading = np.column_stack([cos_pi(actions[free, 0]), sin_pi(actions[free, 0])])
        self.agents[free] = np.clip(self.agents[free] + self.speeds[0] * heading, F(0), self.map)
        for defender in self.defenders:
            self.chase(defender, self.agents[free])
        to_goal = np.sqrt(squares(self.agents, self.goal[None])[:, 0])
        self.arrived |= free & (to_goal <= self.radii[0])
        self.free = free & ~self.arrived
        if len(self.defenders):
            self.free &= np.sqrt(squares(self.agents, self.defenders).min(axis=1)) > self.radii[1]
        self.left -= 1
        return self.sense()

    def chase(self, defender: Points, targets: Points) -> None:
        q = squares(defender[None], targets)[0]
        closest = q.argmin()
        d = np.sqrt(q[closest])
        if d <= self.speeds[1]:
            defender[:] = targets[closest]
        else:
            defender += (targets[closest] - defender) * (self.speeds[1] / d)

    def acting(self) -> NDArray[np.bool_]:
        return self.free

    def measure(self) -> dict[str, float]:
        caught = ~self.free & ~self.arrived
        counts = {"arrived": float(self.arrived.sum()), "caught": float(caught.sum())}
        return {**counts, "steps": float(self.steps - self.left), "distance": -self.fitness()}

    def done(self) -> bool:
        return self.left == 0 or not self.free.any()

    def fitness(self) -> float:
        to_goal = np.sqrt(squares(self.agents, self.goal[None])[:, 0])
        total = 0.0
        for distance, arrived in zip(to_goal, self.arrived, strict=True):
            if not arrived:
                total += float(distance)
        return 0.0 - total / len(self.agents)
