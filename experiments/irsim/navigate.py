"""Robots in IR-SIM: `simulation: navigate.py:Navigate`."""

from pathlib import Path

import irsim
import numpy as np

from swarmwright import Parameter, Simulation
from swarmwright.display import Body, Scene

WORLD = Path(__file__).with_name("world.yaml")
RANGE, BEAMS, SIZE = 3.0, 8, 10.0  # as in world.yaml; the ninth beam is the first one again


class Navigate(Simulation):
    """Each robot drives to the point opposite its start."""

    title = "ir-sim navigation"
    determinism = "bitwise"
    sensors = (
        BEAMS + 3
    )  # nearness of obstacles, counterclockwise from behind; bearing and distance of the goal
    actuators = 2  # speed, 1 m/s at most; turn, 2 rad/s at most
    parameters = {"steps": Parameter(120, "Steps of 0.1 s.", minimum=1)}
    metrics = {"arrived": "Share of robots within 0.5 m of their goal.", "collided": "Share of robots."}

    def __init__(self):
        self.world = irsim.make(str(WORLD), headless=True, log_level="ERROR")

    def reset(self, parameters, seed):
        self.steps = self.left = parameters["steps"]
        self.world.set_random_seed(seed, reload=True)
        self.robots = self.world.robot_list
        self.goals = SIZE - self.positions()
        self.start = self.distances()
        return self.observe()

    def step(self, actions):
        self.world.step([np.array([[speed], [2 * turn]]) for speed, turn in actions.tolist()])
        self.left -= 1
        return self.observe()

    def observe(self):
        scans = np.array([robot.get_lidar_scan()["ranges"][:BEAMS] for robot in self.robots])
        headings = np.array([robot.state[2, 0] for robot in self.robots])
        x, y = (self.goals - self.positions()).T
        bearing = np.arctan2(y, x) - headings
        return np.column_stack([1 - scans / RANGE, np.cos(bearing), np.sin(bearing), self.distances() / SIZE])

    def positions(self):
        return np.array([robot.state[:2, 0] for robot in self.robots])

    def distances(self):
        return np.hypot(*(self.goals - self.positions()).T)

    def acting(self):
        return [index for index, robot in enumerate(self.robots) if not robot.collision]

    def done(self):
        return self.left == 0

    def fitness(self):
        return float(1 - (self.distances() / self.start).mean())

    def measure(self):
        collided = np.mean([robot.collision for robot in self.robots])
        return {"arrived": float((self.distances() < 0.5).mean()), "collided": float(collided)}

    def scene(self):
        robots = zip(self.positions().tolist(), self.robots)
        bodies = [
            Body("agent", x, y, "crashed" if robot.collision else "free", 0.2) for (x, y), robot in robots
        ]
        for obstacle in self.world.obstacle_list:
            bodies.append(Body("obstacle", *obstacle.state[:2, 0].tolist(), "", 0.5))
        return Scene(SIZE, SIZE, self.steps - self.left, self.title, bodies)
