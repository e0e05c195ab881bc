"""Golden vectors of self-tests: steps with the actuators that a controller must compute in them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import STEEP
from swarmwright.controllers.kinds import kind_of
from swarmwright.export.python_family import byte_text, module_of
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Golden:
    """Episodes of some agents, or random sequences without a simulation."""

    sequences: Sequences
    """Whole ones; of a network that overflows the steps before it does, none where that is the first one."""
    words: str
    """What they are."""

    @classmethod
    def of(cls, subject: Subject) -> Self:
        """Return those of a controller that steers agents."""
        tried = subject.tried
        golden = tried.part(before_overflow(subject.specification, tried))
        steps = f"{len(golden)} steps"
        if len(golden) < len(tried):
            steps += " before a node overflows"
        if subject.episodes is None or not len(subject.episodes):
            return cls(golden, f"{golden.count} random sequences, {steps}")
        what = "whole episodes" if len(golden) == len(tried) else "episodes"
        agents = f"{golden.count} agent{'' if golden.count == 1 else 's'}"
        return cls(golden, f"{what} of {agents}, {steps}")

    def values(self) -> dict[str, str]:
        """Return what self-tests in Python have of them."""
        return {"golden": self.words, "sequences": golden_text(self.sequences)}


def golden_text(golden: Sequences) -> str:
    """Return sequences as elements of a tuple in Python: tuples of (sensors, actuators), both as bytes."""
    if not len(golden):
        return ""
    lines: list[str] = []
    for index in range(len(golden)):
        if golden.first[index]:
            lines += [*(["    ),"] if lines else []), "    ("]
        row = f"{byte_text(golden.sensors[index])}, {byte_text(golden.actuators[index])}"
        lines.append(f"        ({row}),")
    return "\n".join([*lines, "    ),"])


_WITHIN_1 = frozenset({"clamp", "sigmoid", STEEP, "tanh"})
"""Activations whose results are from -1 to 1."""


_SAFE = 1e38
"""A third of the largest number of 32 bits."""


def before_overflow(specification: Mapping[str, Any], sequences: Sequences) -> NDArray[np.bool_]:
    """Return which steps, (steps,), come before the first one of their sequence in which a node overflows.

    The engine does not tell, so the exported module for Python is executed. That takes about 0.1 us for each
    weight, iteration and step, unless weights and sensors are such that nothing can overflow.

    Args:
        specification: of the controller.
        sequences: in which no sensor is NaN or infinite.
    """
    kept = np.ones(len(sequences), np.bool_)
    if not kind_of(specification).overflows or _bounded(specification, sequences.sensors):
        return kept
    module: dict[str, Any] = {"__name__": "controller"}
    exec(module_of(Subject(specification), "controller"), module)  # noqa: S102 - of numbers alone
    controller = module["Controller"]()
    for begin, end in pairwise([*np.flatnonzero(sequences.first).tolist(), len(sequences)]):
        controller.reset()
        for step in range(begin, end):
            try:
                controller.step(sequences.sensors[step].tolist())
            except ValueError:
                kept[step:end] = False
                break
    return kept


def _bounded(specification: Mapping[str, Any], sensors: NDArray[np.float32]) -> bool:
    """Return whether no sum of a node can overflow, whatever the outputs of the others are."""
    if specification.get("activation") not in _WITHIN_1:  # weights that learn have no bound
        return False
    computed = int(specification["hidden"]) + int(specification["actuators"])
    weights = np.abs(np.array(specification["weights"], np.float64)).reshape(computed, -1)
    largest = max(1.0, float(np.abs(sensors).max(initial=0.0)))
    return bool(weights.sum(axis=1).max() * largest < _SAFE)
