"""Random search over parameters of agents that steer themselves: python tune.py BROKER minisim 2."""

import math
import random

from tool import close, connect, evaluate

PARAMETERS = {"steering": "rule", "placement": "random", "numAgents": 3, "numDefenders": 3, "seed": 1}

connect()
try:
    random.seed(1)
    highest = -math.inf
    for _ in range(30):
        candidate = {"avoidance": random.uniform(0, 5), "avoidanceRadius": random.uniform(0.5, 8)}
        fitness = evaluate({**PARAMETERS, **candidate})
        if fitness > highest:
            highest = fitness
            print(f"fitness {fitness} with {candidate}")
finally:
    close()
