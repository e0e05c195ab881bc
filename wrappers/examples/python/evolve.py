"""A (1+1) evolution strategy: python evolve.py BROKER SIMULATION DIMENSIONS SENSORS ACTUATORS."""

import math
import random
import sys

from tool import close, connect, evaluate

SENSORS, ACTUATORS = int(sys.argv[4]), int(sys.argv[5])
CANDIDATES, SEEDS = 30, (1, 2)
PARAMETERS = {"numAgents": 2, "placement": "random"}


def controller(weights):
    """Return a stateless network: each actuator is tanh of a weighted sum of the sensors and 1."""
    size = SENSORS + 1
    rows = [weights[first : first + size] for first in range(0, len(weights), size)]

    def act(_agent, sensors):
        return [math.tanh(sum(w * x for w, x in zip(row, (*sensors, 1.0), strict=True))) for row in rows]

    return act


def mean_fitness(weights):
    return sum(evaluate({**PARAMETERS, "seed": seed}, controller(weights)) for seed in SEEDS) / len(SEEDS)


connect()
try:
    random.seed(1)
    best = [0.0] * (SENSORS + 1) * ACTUATORS
    highest = mean_fitness(best)
    print(f"candidate 0: fitness {highest}")
    for number in range(1, CANDIDATES):
        candidate = [weight + random.gauss(0.0, 0.5) for weight in best]
        fitness = mean_fitness(candidate)
        if fitness > highest:
            best, highest = candidate, fitness
            print(f"candidate {number}: fitness {highest}")
finally:
    close()
