"""Minisim as a program that is stepped over standard input and output, with the arithmetic of the tests'."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[4]))
from tests.python.simulations.minisim import Minisim

DEFAULTS = {name: getattr(one, "default", one) for name, one in Minisim.parameters.items()}


def say(**answer: Any) -> None:
    print(json.dumps(answer), flush=True)


def main() -> None:
    world = Minisim()
    print("a line that is no answer")
    for line in sys.stdin:
        message = json.loads(line)
        if "reset" in message:
            given = message["reset"]
            seen = world.reset({**DEFAULTS, **given["parameters"]}, given["seed"])
        else:
            seen = world.step(np.array(message["actuators"], np.float32))
        if world.done():
            say(done=True, fitness=world.fitness(), metrics=world.measure())
        else:
            say(sensors=seen.tolist(), acting=np.flatnonzero(world.acting()).tolist())


if __name__ == "__main__":
    main()
