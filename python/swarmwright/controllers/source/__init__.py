"""Source code of controllers: what the kinds share, in C and C++, in Python, and as graphs of ONNX."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Evolved:
    """A controller with its weights, of which code is made."""

    specification: Mapping[str, Any]
    """As plain values, see protocol/schemas/controller.schema.json."""

    @property
    def kind(self) -> str:
        """The kind of controller."""
        return str(self.specification["kind"])

    @cached_property
    def weights(self) -> NDArray[np.float32]:
        """The weights, in the order of the specification."""
        return np.array(self.specification["weights"], np.float32)

    @cached_property
    def checks_random(self) -> bool:
        """Whether steps refuse a random number that is not from 0 to 1."""
        return False
