"""Checks that a method reaches the same state when told the same in a new process."""

import json
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha256
from importlib import import_module
from typing import Any

import numpy as np

from swarmwright.common.typing import Fitness
from swarmwright.methods import METHODS, Method
from swarmwright.testing._common import synthetic_metrics

_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from swarmwright.testing import _replay; _replay.main()"  # noqa: E501 - one line of a command


def check_replay(method: Method) -> None:
    """Check that the conversation of a new method, told again in a new process, gives the same genomes."""
    told: list[list[float | None]] = []
    asked: list[str] = []
    while not method.done:
        genomes = method.ask()
        asked.append(sha256(genomes.tobytes()).hexdigest())
        fitness = -np.abs(genomes.astype(np.float64)).max(axis=1)
        fitness[len(told) % 3 :: 5] = np.nan
        method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))
        told.append([None if np.isnan(value) else value for value in fitness.tolist()])
    kind = type(method)
    subject = method.representation
    conversation = {
        "method": [kind.__module__, kind.__qualname__],
        "options": method.options.model_dump(),
        "representation": [type(subject).__module__, type(subject).__qualname__],
        "controller": subject.options.model_dump(),
        "sizes": {"sensors": subject.sensors, "actuators": subject.actuators},
        "seed": method.seed,
        "told": told,
    }
    process = subprocess.run(
        [sys.executable, "-P", "-c", _CODE, json.dumps(sys.path)],
        input=json.dumps(conversation),
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, f"the method cannot be told again in a new process:\n{process.stderr}"
    again = json.loads(process.stdout)
    first = next(
        (index for index, pair in enumerate(zip(asked, again, strict=True)) if len({*pair}) > 1), None
    )
    assert first is None, f"told again in a new process, generation {first} has other genomes"


def main() -> None:
    """Replay the conversation given on standard input; write the genomes asked for."""
    conversation: dict[str, Any] = json.load(sys.stdin)
    representation, kind = _find(*conversation["representation"]), conversation["options"]["kind"]
    component: Any = METHODS.get(kind) if METHODS.is_in_file(kind) else _find(*conversation["method"])
    subject = representation(
        representation.options_model(**conversation["controller"]), **conversation["sizes"]
    )
    method = component(component.options_model(**conversation["options"]), subject, seed=conversation["seed"])
    asked = []
    for told in conversation["told"]:
        genomes, fitness = method.ask(), _fitness(told)
        asked.append(sha256(genomes.tobytes()).hexdigest())
        method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))
    json.dump(asked, sys.stdout)


def _fitness(values: Sequence[float | None]) -> Fitness:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _find(module: str, name: str) -> Any:  # noqa: ANN401 - any class
    return getattr(import_module(module), name)
