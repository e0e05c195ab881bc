"""Where recurrent networks overflow, after which exported controllers refuse steps until they are reset."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import STEEP
from swarmwright.controllers.kinds import kind_of
from swarmwright.export.python import module_of
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

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
