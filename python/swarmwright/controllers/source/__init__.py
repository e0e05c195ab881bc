"""Code generation shared by the kinds of controllers: C and C++, Python, and ONNX graphs."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Evolved:
    """A controller with its weights, for code generation."""

    specification: Mapping[str, Any]
    """The controller as plain values, see protocol/schemas/controller.schema.json."""

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
        """Whether steps reject a random sensor that is outside 0..1."""
        return False
