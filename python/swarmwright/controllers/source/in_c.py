"""Source code in C and C++: the arithmetic of decision 002, operation by operation."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.activations import STEEP, find_activations
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.text import literals, templates, wrap_items

render = templates(__file__, "templates")

TYPES = {16: "uint16_t", 32: "uint32_t"}
"""Unsigned integer types by their bits."""


@dataclass(frozen=True)
class Table:
    """A table of constants."""

    name: str
    type: str
    length: int
    text: str
    """The lines between the braces."""
    evolved: NDArray[np.float32] | NDArray[np.uint32] | None = None
    """The evolved numbers; None for a table that belongs to the structure of the controller."""


@dataclass(frozen=True)
class Code:
    """The parts of a controller's source that depend on its kind."""

    tables: tuple[Table, ...]
    kernel: str
    """Functions."""
    step: str
    """The functions reset and step."""
    state: str
    """Members of the struct."""
    state_words: str
    """Description of the struct's content."""
    refuses: str = ""
    """A sentence on other reasons for which a step returns false than NaN or infinite sensors."""

    def uses_macro(self, name: str) -> bool:
        """Whether the code uses a macro."""
        return f"{name}(" in self.step or f"{name}(" in self.kernel


def refusal_condition(language: Mapping[str, str], states: int = 0, extra_condition: str = "") -> str:
    """Return the condition in which a step is refused; states: the number of states of a machine."""
    receiver, function = language["self"], f"{language['detail']}{language['p']}_finite"
    parts = [f"{receiver}ready != {language['PREFIX']}_READY"]
    if states:
        parts.append(f"{receiver}state >= {states}")
    parts.append(f"!{function}(sensors)")
    return " || ".join([*parts, *([extra_condition] if extra_condition else [])])


def overflow(language: Mapping[str, str], computed: int) -> tuple[str, str]:
    """Return the function that detects an overflow, and its use in a step.

    Both are empty for controllers inside simulations, which behave as in the engine.
    """
    if language.get("loaded"):
        return "", ""
    values = {**language, "computed": str(computed)}
    return render("c_overflow.txt", language), render("c_overflow_check.txt", values).rstrip()


OVERFLOW = (
    "It also returns false, with the actuators as before, when sensors are so large that a node overflows to "
    "NaN, and then until the next reset."
)
"""Note on refused steps of recurrent networks."""


def weights_table(weights: NDArray[np.float32], rows: list[tuple[str, int]]) -> Table:
    """Return the table of weights; rows: name of each node and its number of weights."""
    texts = literals(weights)
    lines, at = [], 0
    for name, count in rows:
        lines.append(f"    /* {name}: bias, weights */\n{wrap_items(texts[at : at + count])}")
        at += count
    return Table("weights", "float", len(texts), "\n".join(lines), weights)


def network(controller: Evolved, language: dict[str, str]) -> str:
    """Return the functions of the layers of a network and of its actuators."""
    hidden, output = find_activations(controller.specification)
    functions = []
    if {hidden, output} & {"tanh", "sigmoid", STEEP}:
        functions.append(render("c_tanh.txt", language))
    functions.append(_layer_function(hidden, "", language))
    if output != hidden:
        functions.append(_layer_function(output, "output_", language))
    low, high = controller.specification["output_range"]
    functions.append(actuator_function(float(low), float(high), language))
    return "\n".join(functions)


def _layer_function(activation: str, function_prefix: str, language: dict[str, str]) -> str:
    values = {**language, "which": function_prefix}
    return "\n".join(render(name, values) for name in (f"c_activation_{activation}.txt", "c_network.txt"))


def actuator_function(low: float, high: float, language: dict[str, str]) -> str:
    """Return the function that maps an output, low to high, to an actuator."""
    words, lines = _actuator(low, high, language)
    return render("c_actuator.txt", {**language, "output_range": words, "actuator": lines})


def double(subject: str, language: dict[str, str]) -> str:
    """Return a check that `double` has 64 bits; subject: subject of its message."""
    return render("c_double.txt", {**language, "what": subject})


def _actuator(low: float, high: float, language: dict[str, str]) -> tuple[str, str]:
    """Return the mapping of an output to -1..1 as a description and as code."""
    p = language["p"]
    if (low, high) == (-1, 1):
        return "as it is", "    const float a = output;"
    if (low, high) == (0, 1):
        lines = [f"{p}_product product = 2.0f * output;", f"{p}_real a = product - 1.0f;"]
        return "0..1 becomes -1..1", "\n".join(f"    {line}" for line in lines)
    bounds = np.array([low, high], np.float32)
    lower, width = literals(np.array([bounds[0], bounds[1] - bounds[0]], np.float32))
    lines = [
        f"static const float low = {lower};",
        f"const volatile float width = {width}; /* a constant divisor may become a factor */",
        f"{p}_real above = output - low;",
        f"{p}_real share = above / width;",
        f"{p}_product product = share * 2.0f;",
        f"{p}_real a = product - 1.0f;",
    ]
    first, last = (shortest_decimal(float(bound)) for bound in bounds)
    return f"{first}..{last} becomes -1..1", "\n".join(f"    {line}" for line in lines)
