"""Radio communication by ns-3: `simulation: gather.py:Gather`."""

import numpy as np

from swarmwright import Parameter, Simulation
from swarmwright.simulations.ns3 import Radios

STEP = 0.1  # seconds


class Gather(Simulation):
    """Agents that know each other's positions by radio only gather."""

    title = "gather by radio"
    sensors = 3  # (dx, dy) to the middle of the agents heard within the last second, and their share
    actuators = 2  # speed in x and y, 1 m/s at most
    copies = False  # ns-3 has one simulation in a process
    determinism = "bitwise"
    metrics = {"delivered": "Share of the messages that arrived at another agent."}
    parameters = {
        "agents": Parameter(8, "Number of agents.", minimum=2, maximum=100),
        "range": Parameter(4.0, "Range of the radios, m.", minimum=0.1),
        "message": Parameter(100, "Bytes of a message.", minimum=8, maximum=2200),
        "steps": Parameter(40, "Steps of 0.1 s.", minimum=1),
    }
    radios = None

    def reset(self, parameters, seed):
        if self.radios is not None:
            self.radios.close()
        self.count, self.padding = parameters["agents"], bytes(parameters["message"] - 8)
        self.radios = Radios(self.count, seed=seed, range=parameters["range"])
        self.positions = np.random.default_rng(seed).uniform(-3, 3, (self.count, 2))
        self.received = np.full((self.count, self.count, 2), np.nan)  # position of a sender, at a receiver
        self.age = np.zeros((self.count, self.count))  # steps since it was received
        self.remaining, self.sent, self.arrived = parameters["steps"], 0, 0
        return self.communicate()

    def step(self, actions):
        self.positions += STEP * actions
        self.remaining -= 1
        return self.communicate()

    def communicate(self):
        positions = self.positions.astype("<f4")
        messages = [(agent, positions[agent].tobytes() + self.padding) for agent in range(self.count)]
        self.age += 1
        for delivery in self.radios.step(self.positions, messages, STEP):
            self.received[delivery.receiver, delivery.sender] = np.frombuffer(delivery.payload, "<f4", 2)
            self.age[delivery.receiver, delivery.sender] = 0
            self.arrived += 1
        self.sent += self.count * (self.count - 1)
        recent = (self.age < 10) & np.isfinite(self.received).all(axis=2)
        offsets = np.where(recent[:, :, None], self.received - self.positions[:, None], 0).sum(axis=1)
        count = recent.sum(axis=1, keepdims=True)
        return np.hstack([offsets / np.maximum(count, 1), count / (self.count - 1)])

    def done(self):
        if self.remaining == 0:
            self.radios.close()
        return self.remaining == 0

    def measure(self):
        return {"delivered": self.arrived / self.sent}

    def fitness(self):
        return -self.positions.std(axis=0).sum()
