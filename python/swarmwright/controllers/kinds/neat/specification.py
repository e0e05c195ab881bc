"""Networks of NEAT: their nodes, and the numbers that their arithmetic has."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

KIND = "neat"

EXP = {
    "overflow": 709.782712893384, "underflow": -745.1332191019411,
    "inverse_ln": 1.4426950408889634, "ln_high": 0.6931471803691238, "ln_low": 1.9082149292705877e-10,
    "shift": 37.42994775023705,
    "first": 0.16666666666666602, "second": -0.0027777777777015593, "third": 6.613756321437934e-05,
    "fourth": -1.6533902205465252e-06, "fifth": 4.1381367970572385e-08,
}  # fmt: skip
"""Of e^x in binary64, see decision 002."""


def sizes(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return what other networks have besides: how many nodes are hidden, and their activation."""
    return {
        "hidden": len(specification["sources"]) - int(specification["actuators"]),
        "activation": "tanh, at the actuators sigmoid",
    }


def rows(
    specification: Mapping[str, Any], weights: NDArray[np.float32]
) -> Iterator[tuple[list[int], NDArray[np.float32], bool]]:
    """Yield each node but the sensors: what it sees; its bias and weights; and whether it is an actuator's.

    The weights of an actuator's node end with its slope.
    """
    sources = specification["sources"]
    hidden, at = len(sources) - int(specification["actuators"]), 0
    for node, seen in enumerate(sources):
        end = at + 1 + len(seen) + (node >= hidden)
        yield seen, weights[at:end], node >= hidden
        at = end
