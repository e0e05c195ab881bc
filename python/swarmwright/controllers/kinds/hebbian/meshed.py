"""Networks with Hebbian learning as fully meshed ones."""

from collections.abc import Mapping
from typing import Any

KIND = "hebbian"


def as_meshed(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fully meshed network that it is before it has learnt, without the learning rate."""
    meshed = {"kind": "fully_meshed", "activation": "clamp", "output_range": [0.0, 1.0]}
    return {**specification, **meshed, "weights": list(specification["weights"][1:])}
