"""Writes golden vectors of a controller, as protocol/vectors/controllers.json has them.

    python -m tests.protocol.cases NAME SPECIFICATION.json

The specification has its weights. Sensors are drawn from -1 to 1; two episodes of four steps each show that
a reset forgets what a controller keeps. The actuators are those of `tests.protocol.controllers`.
"""

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.protocol.controllers import Controller

EPISODES = 2
STEPS = 4
Step = tuple[bool, Sequence[np.float32]]
"""Whether the controller is reset before the step, and the sensors."""


def hexadecimal(value: np.float32) -> str:
    """The number as C99 writes it, without zeros at the end."""
    mantissa, _, exponent = float(value).hex().partition("p")
    return f"{mantissa.rstrip('0').rstrip('.')}p{exponent}"


def row(name: str, values: Sequence[np.float32]) -> dict[str, list[str]]:
    bits = np.array(values, dtype=np.float32).view(np.uint32)
    return {f"{name}s": [hexadecimal(value) for value in values], f"{name}_bits": [f"{b:08x}" for b in bits]}


def lines(name: str, specification: dict[str, Any], steps: Iterable[Step]) -> str:
    """The vectors of a controller as lines of the file."""
    controller = Controller(specification)
    rows = []
    with np.errstate(over="ignore", invalid="ignore"):
        for reset, sensors in steps:
            if reset:
                controller.reset()
            step = {"reset": reset, **row("sensor", sensors), **row("actuator", controller.step(sensors))}
            rows.append(f"    {json.dumps(step)}")
    head = (
        f'  {{"name": {json.dumps(name)},\n   "specification": {json.dumps(specification)},\n   "steps": [\n'
    )
    return head + ",\n".join(rows) + "\n   ]}"


def drawn(sensors: int, seed: int = 1) -> list[Step]:
    """Sensors of two episodes."""
    numbers = np.random.default_rng(seed).uniform(-1, 1, (EPISODES * STEPS, sensors)).astype(np.float32)
    return [(index % STEPS == 0, list(values)) for index, values in enumerate(numbers)]


if __name__ == "__main__":
    document = json.loads(Path(sys.argv[2]).read_text(encoding="utf-8"))
    sys.stdout.write(lines(sys.argv[1], document, drawn(document["sensors"])) + "\n")
