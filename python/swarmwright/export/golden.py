"""Golden vectors of self-tests: steps and the actuators that a controller must compute."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import STEEP
from swarmwright.controllers.kinds import kind_of
from swarmwright.export.python_family import byte_text, python_module
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Golden:
    """Episodes of some agents, or random sequences without a simulation."""

    sequences: Sequences
    """Whole sequences; for a network that overflows, the steps before the overflow."""
    words: str
    """Description of the sequences."""

    @classmethod
    def from_subject(cls, subject: Subject) -> Self:
        """Return the golden vectors of a controller that steers agents."""
        tried = subject.self_test_sequences
        golden = tried.part(find_steps_before_overflow(subject.specification, tried))
        steps = f"{len(golden)} steps"
        if len(golden) < len(tried):
            steps += " before a node overflows"
        if subject.episodes is None or not len(subject.episodes):
            return cls(golden, f"{golden.count} random sequences, {steps}")
        noun = "whole episodes" if len(golden) == len(tried) else "episodes"
        agents = f"{golden.count} agent{'' if golden.count == 1 else 's'}"
        return cls(golden, f"{noun} of {agents}, {steps}")

    def values(self) -> dict[str, str]:
        """Return the replacements for self-tests in Python."""
        return {"golden": self.words, "sequences": golden_text(self.sequences)}


def golden_text(golden: Sequences) -> str:
    """Format sequences as elements of a Python tuple: tuples of (sensors, actuators), both as bytes."""
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
"""Activations with results in -1..1."""


_SAFE = 1e38
"""A third of the largest binary32 number."""


def find_steps_before_overflow(specification: Mapping[str, Any], sequences: Sequences) -> NDArray[np.bool_]:
    """Return a mask, (steps,), of the steps before a node overflows in their sequence.

    The engine does not report overflows, so the exported Python module is executed. That takes about 0.1 us
    for each weight, iteration and step, unless weights and sensors exclude an overflow.

    Args:
        specification: specification of the controller.
        sequences: with finite sensors.
    """
    mask = np.ones(len(sequences), np.bool_)
    if not kind_of(specification).overflows or _is_bounded(specification, sequences.sensors):
        return mask
    module: dict[str, Any] = {"__name__": "controller"}
    exec(python_module(Subject(specification), "controller"), module)  # noqa: S102 - contains numbers only
    controller = module["Controller"]()
    for begin, end in pairwise([*np.flatnonzero(sequences.first).tolist(), len(sequences)]):
        controller.reset()
        for step in range(begin, end):
            try:
                controller.step(sequences.sensors[step].tolist())
            except ValueError:
                mask[step:end] = False
                break
    return mask


def _is_bounded(specification: Mapping[str, Any], sensors: NDArray[np.float32]) -> bool:
    """Whether no sum of a node can overflow, for any outputs of other nodes."""
    if specification.get("activation") not in _WITHIN_1:  # learning weights are unbounded
        return False
    computed = int(specification["hidden"]) + int(specification["actuators"])
    weights = np.abs(np.array(specification["weights"], np.float64)).reshape(computed, -1)
    largest = max(1.0, float(np.abs(sensors).max(initial=0.0)))
    return bool(weights.sum(axis=1).max() * largest < _SAFE)
