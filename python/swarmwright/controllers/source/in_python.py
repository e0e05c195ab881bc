"""Source code in Python and MicroPython: the arithmetic of decision 002.

Floats have 64 bits in Python, and 64 or 32 in MicroPython. For +, -, * and /, computing an operation on two
binary32 numbers in binary64 and rounding the result to binary32 gives the correctly rounded result.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.activations import STEEP, STEEPNESS, find_activations
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.text import templates

render = templates(__file__, "templates")

Values = NDArray[np.float32] | NDArray[np.float64] | NDArray[np.uint16] | NDArray[np.uint32]
Numbers = Callable[[Values], str]
"""Formats numbers as an expression for an array."""

_TANH = {
    "LIMIT": 9.15, "P1": 0.015736774, "P2": 7.970824e-5, "P3": 4.2581547e-8,
    "Q1": 0.11480684, "Q2": 0.0013933508, "Q3": 2.7218455e-6,
}  # fmt: skip


@dataclass(frozen=True)
class PythonCode:
    """The parts of a module that depend on the kind of controller."""

    numbers: str
    """Assignments of constants, the weights among them."""
    functions: str
    """Functions of the module."""
    init: str
    """Lines of the constructor."""
    reset: str
    """Lines of the method reset."""
    step: str
    """Lines of the method step."""
    state_words: str
    """Description of the state that is kept from step to step."""
    imports: str = ""
    """Additional import lines."""
    refuses: str = ""
    """A sentence on other reasons for ValueError in a step than sensors that are not finite."""


OVERFLOW = [
    "if any(output != output for output in outputs):",
    '    raise ValueError("a node has overflowed, sensors were too large: reset the controller")',
]
RETURN_ACTUATORS = ["return [_actuator(value, cell) for value in values]"]


def indent_method(lines: list[str]) -> str:
    """Indent lines as the body of a method."""
    return "\n".join(f"        {line}" for line in lines)


def constants(controller: Evolved, numbers: Numbers) -> list[str]:
    """Return the constants that the functions of `network` need."""
    lines = []
    functions = set(find_activations(controller.specification))
    if functions & {"tanh", "sigmoid", STEEP}:
        lines += tanh_constants(numbers)
    if STEEP in functions:
        lines.append(f"(_STEEPNESS,) = {numbers(np.array([STEEPNESS], np.float32))}")
    low, high = np.array(controller.specification["output_range"], np.float32)
    if (low, high) not in ((-1, 1), (0, 1)):
        lines.append(f"_LOW, _WIDTH = {numbers(np.array([low, high - low], np.float32))}")
    return lines


def tanh_constants(numbers: Numbers) -> list[str]:
    """Return the constants of the hyperbolic tangent."""
    values = np.array(list(_TANH.values()), np.float32)
    return [f"{', '.join(f'_{name}' for name in _TANH)} = {numbers(values)}"]


def network(controller: Evolved) -> str:
    """Return the functions of the layers of a network and of its actuators."""
    hidden, output = find_activations(controller.specification)
    parts = [render("python_tanh.txt", {})] if {hidden, output} & {"tanh", "sigmoid", STEEP} else []
    for activation, function_prefix in ((hidden, ""), (output, "output_"))[: 1 if hidden == output else 2]:
        parts.append(f"def _{function_prefix}activation(a, cell):\n{ACTIVATIONS[activation]}\n")
        parts.append(render("python_network.txt", {"which": function_prefix}))
    parts.append(actuator_function(*controller.specification["output_range"]))
    return "\n\n".join(parts).rstrip("\n")


def actuator_function(*output_range: float) -> str:
    """Return the function that maps an output, of this range, to an actuator."""
    low, high = np.array(output_range, np.float32)
    words, lines = f"{shortest_decimal(float(low))}..{shortest_decimal(float(high))} becomes -1..1", []
    if (low, high) == (-1, 1):
        words = "as it is"
    elif (low, high) == (0, 1):
        lines = ["cell[0] = 2.0 * a", "cell[0] = cell[0] - 1.0", "a = cell[0]"]
    else:
        lines = [
            "cell[0] = a - _LOW",
            "cell[0] = cell[0] / _WIDTH",
            "cell[0] = cell[0] * 2.0",
            "cell[0] = cell[0] - 1.0",
            "a = cell[0]",
        ]
    actuator = "\n".join(f"    {line}" for line in lines)
    return render("python_actuator.txt", {"output_range": words, "actuator": actuator})


ACTIVATIONS = {
    "tanh": "    return _tanh(a, cell)",
    "sigmoid": (
        "    scaled = _rounded(0.5 * _tanh(_rounded(0.5 * a, cell), cell), cell)\n"
        "    return _rounded(0.5 + scaled, cell)"
    ),
    STEEP: (
        "    steep = _rounded(_STEEPNESS * a, cell)\n"
        "    scaled = _rounded(0.5 * _tanh(_rounded(0.5 * steep, cell), cell), cell)\n"
        "    return _rounded(0.5 + scaled, cell)"
    ),
    "relu": "    return 0.0 if a < 0.0 else a",
    "clamp": "    return 0.0 if a < 0.0 else 1.0 if a > 1.0 else a",
    "linear": "    return a",
}
