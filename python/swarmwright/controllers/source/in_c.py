"""Source code in C and C++: the arithmetic of decision 002, operation by operation."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.activations import STEEP, of_nodes
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.text import literals, templates, wrapped

render = templates(__file__, "templates")

TYPES = {16: "uint16_t", 32: "uint32_t"}
"""Of integers, by their bits."""


@dataclass(frozen=True)
class Table:
    """Constant numbers."""

    name: str
    type: str
    length: int
    text: str
    """Their lines between the braces."""
    evolved: NDArray[np.float32] | NDArray[np.uint32] | None = None
    """The numbers, where these are evolved, and not what the controller is made of."""


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
    """What the struct holds."""
    refuses: str = ""
    """A sentence on when a step returns false, besides for sensors that are NaN or infinite."""

    def reads(self, name: str) -> bool:
        """Return whether the code calls a macro."""
        return f"{name}(" in self.step or f"{name}(" in self.kernel


def refused(language: Mapping[str, str], states: int = 0, beyond: str = "") -> str:
    """Return the condition in which a step changes nothing; states: how many there are, of a machine."""
    own, function = language["self"], f"{language['detail']}{language['p']}_finite"
    parts = [f"{own}ready != {language['PREFIX']}_READY"]
    if states:
        parts.append(f"{own}state >= {states}")
    parts.append(f"!{function}(sensors)")
    return " || ".join([*parts, *([beyond] if beyond else [])])


def overflow(language: Mapping[str, str], computed: int) -> tuple[str, str]:
    """Return the function that notices an overflow, and what a step does then.

    Both are empty for controllers inside of simulations, which act as the engine's do.
    """
    if language.get("loaded"):
        return "", ""
    values = {**language, "computed": str(computed)}
    return render("c_overflow.txt", language), render("c_overflow_check.txt", values).rstrip()


OVERFLOW = (
    "It also returns false, with the actuators as before, when sensors are so large that a node overflows to "
    "NaN, and then until the next reset."
)
"""When a step of a recurrent network is refused, besides."""


def weights_table(weights: NDArray[np.float32], rows: list[tuple[str, int]]) -> Table:
    """Return the table of weights; rows: a node's name and how many numbers it has."""
    texts = literals(weights)
    lines, at = [], 0
    for name, count in rows:
        lines.append(f"    /* {name}: bias, weights */\n{wrapped(texts[at : at + count])}")
        at += count
    return Table("weights", "float", len(texts), "\n".join(lines), weights)


def network(controller: Evolved, language: dict[str, str]) -> str:
    """Return the functions of the layers of a network and of its actuators."""
    hidden, output = of_nodes(controller.specification)
    functions = []
    if {hidden, output} & {"tanh", "sigmoid", STEEP}:
        functions.append(render("c_tanh.txt", language))
    functions.append(_layer_function(hidden, "", language))
    if output != hidden:
        functions.append(_layer_function(output, "output_", language))
    low, high = controller.specification["output_range"]
    functions.append(actuator_function(float(low), float(high), language))
    return "\n".join(functions)


def _layer_function(activation: str, which: str, language: dict[str, str]) -> str:
    values = {**language, "which": which}
    return "\n".join(render(name, values) for name in (f"c_activation_{activation}.txt", "c_network.txt"))


def actuator_function(low: float, high: float, language: dict[str, str]) -> str:
    """Return the function that maps an output, low to high, to an actuator."""
    words, lines = _actuator(low, high, language)
    return render("c_actuator.txt", {**language, "output_range": words, "actuator": lines})


def double(what: str, language: dict[str, str]) -> str:
    """Return what refuses compilers whose double has not 64 bits; what: is computed with it."""
    return render("c_double.txt", {**language, "what": what})


def _actuator(low: float, high: float, language: dict[str, str]) -> tuple[str, str]:
    """Return in words and as code how an output is mapped to -1..1."""
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
