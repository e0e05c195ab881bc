"""Activation functions of a network's hidden and output nodes."""

from collections.abc import Mapping
from typing import Any

STEEP = "steep_sigmoid"
"""The activation of EvoStick's outputs: the logistic function of `STEEPNESS` times a sum."""
STEEPNESS = 4.924273


def find_activations(specification: Mapping[str, Any]) -> tuple[str, str]:
    """Return the activation of the hidden nodes and that of the output nodes of a network.

    Both are equal if all nodes share one function, and in a layered network without hidden nodes.
    """
    activation = str(specification["activation"])
    output = str(specification.get("output_activation") or activation)
    return output if specification.get("hidden") == [] else activation, output


def describe_activations(specification: Mapping[str, Any]) -> str:
    """Return the activation functions: `tanh`, or `tanh, linear outputs`."""
    hidden, output = find_activations(specification)
    return output if hidden == output else f"{hidden}, {output} outputs"


def describe_network(specification: Mapping[str, Any]) -> str:
    """Return kind, sizes and activations: `layered, 4-8-1, tanh`."""
    sensors, actuators = specification.get("sensors"), specification.get("actuators")
    hidden = specification.get("hidden")
    parts = [str(specification.get("kind", "controller"))]
    if sensors is not None and actuators is not None:
        middle = hidden if isinstance(hidden, list) else [] if hidden is None else [hidden]
        parts.append("-".join(str(size) for size in (sensors, *middle, actuators)))
    if "activation" in specification:
        parts.append(describe_activations(specification))
    return ", ".join(parts)
