"""Activation functions of a network's hidden and output nodes."""

from collections.abc import Mapping
from typing import Any


def of_nodes(specification: Mapping[str, Any]) -> tuple[str, str]:
    """Return the activation of the hidden nodes and that of the output nodes of a network.

    They are equal if all nodes have the same, and in a layered network without hidden nodes.
    """
    activation = str(specification["activation"])
    output = str(specification.get("output_activation") or activation)
    return output if specification.get("hidden") == [] else activation, output


def in_words(specification: Mapping[str, Any]) -> str:
    """Return the activation functions: `tanh`, or `tanh, linear outputs`."""
    hidden, output = of_nodes(specification)
    return output if hidden == output else f"{hidden}, {output} outputs"
