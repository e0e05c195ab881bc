"""Source code of EvoStick's network, which is a layered network."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from swarmwright.controllers.activations import STEEP
from swarmwright.controllers.kinds.layered import code as layered_code
from swarmwright.controllers.source import Evolved, in_c, in_onnx, in_python


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    return layered_code.c(to_layered(controller), language)


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    return layered_code.python(to_layered(controller), numbers)


def onnx(controller: Evolved, graph: in_onnx.Graph) -> None:
    """Add the controller to a graph of ONNX."""
    layered_code.onnx(to_layered(controller), graph)


def to_layered(controller: Evolved) -> Evolved:
    """Return the layered network that computes the same bits."""
    return replace(controller, specification=as_layered(controller.specification))


def as_layered(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return the specification of the layered network that computes the same bits.

    Its weights are in the order of layered networks, each bias first.
    """
    rows = np.reshape(specification["weights"], (-1, int(specification["actuators"]))).T
    weights = np.roll(rows, 1, axis=1).ravel().tolist()
    fields = {"kind": "layered", "hidden": [], "activation": STEEP, "output_range": [0.0, 1.0]}
    return {**specification, **fields, "weights": weights}
