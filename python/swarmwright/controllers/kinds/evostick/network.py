"""EvoStick's network as a layered one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

STEEP = "steep_sigmoid"
"""The activation of `as_layered`: the logistic function of `STEEPNESS` times a sum."""
STEEPNESS = 4.924273


def as_layered(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return the layered network that computes the same bits, for code that knows layers.

    Its weights are in the order of layered networks, each bias first.
    """
    rows = np.reshape(specification["weights"], (-1, int(specification["actuators"]))).T
    weights = np.roll(rows, 1, axis=1).ravel().tolist()
    layered = {"kind": "layered", "hidden": [], "activation": STEEP, "output_range": [0.0, 1.0]}
    return {**specification, **layered, "weights": weights}
