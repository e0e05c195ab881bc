"""Source code of NEAT networks, and the constants of their arithmetic."""

from collections.abc import Iterator, Mapping
from textwrap import indent
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.source import Evolved, in_c, in_python
from swarmwright.controllers.source.text import literals, templates, wrap_items

render = templates(__file__)

EXP = {
    "overflow": 709.782712893384, "underflow": -745.1332191019411,
    "inverse_ln": 1.4426950408889634, "ln_high": 0.6931471803691238, "ln_low": 1.9082149292705877e-10,
    "shift": 37.42994775023705,
    "first": 0.16666666666666602, "second": -0.0027777777777015593, "third": 6.613756321437934e-05,
    "fourth": -1.6533902205465252e-06, "fifth": 4.1381367970572385e-08,
}  # fmt: skip
"""Constants of e^x in binary64, see decision 002."""


def iterate_nodes(
    specification: Mapping[str, Any], weights: NDArray[np.float32]
) -> Iterator[tuple[list[int], NDArray[np.float32], bool]]:
    """Yield each node but the sensors: its inputs, its bias and weights, and whether it is an actuator.

    The weights of an actuator's node end with its slope.
    """
    sources = specification["sources"]
    hidden, at = len(sources) - int(specification["actuators"]), 0
    for node, inputs in enumerate(sources):
        end = at + 1 + len(inputs) + (node >= hidden)
        yield inputs, weights[at:end], node >= hidden
        at = end


def prune(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return a network without connections of weight 0, and without hidden nodes that no other node hears.

    Its outputs are the same, to the bit.
    """
    sensors = int(specification["sensors"])
    rows = []
    for inputs, row, _ in iterate_nodes(specification, np.array(specification["weights"], np.float32)):
        incoming = row[1 : 1 + len(inputs)]
        pairs = [(source, weight) for source, weight in zip(inputs, incoming, strict=True) if weight != 0]
        rows.append((row[0], pairs, row[1 + len(inputs) :]))
    heard = {
        source for node, (_, pairs, _) in enumerate(rows, sensors) for source, _ in pairs if source != node
    }
    last = sensors + len(rows) - int(specification["actuators"])
    nodes = [node for node in range(sensors + len(rows)) if node < sensors or node in heard or node >= last]
    numbers = {node: number for number, node in enumerate(nodes)}
    sources, weights = [], []
    for node in nodes[sensors:]:
        bias, pairs, slope = rows[node - sensors]
        sources.append([numbers[source] for source, _ in pairs])
        weights += [bias, *(weight for _, weight in pairs), *slope]
    return {**specification, "sources": sources, "weights": weights}


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    controller = Evolved(prune(controller.specification))
    specification = controller.specification
    sensors, sources = int(specification["sensors"]), specification["sources"]
    hidden = len(sources) - int(specification["actuators"])
    bits = 16 if sensors + len(sources) < 1 << 16 and max(map(len, sources)) < 1 << 16 else 32
    kind = in_c.TYPES[bits]
    step = render(
        "c_step.txt",
        {
            **language,
            "words": f"{hidden} hidden nodes",
            "computed": str(len(sources)),
            "hidden": str(hidden),
            "iterations": str(specification["iterations"]),
            "refused": in_c.refusal_condition(language),
            "type": kind,
            "bits": str(bits),
        },
    )
    texts, lines, input_lines = literals(controller.weights), [], []
    at = 0
    for node, (inputs, numbers, is_output) in enumerate(iterate_nodes(specification, controller.weights)):
        name = f"node {sensors + node}: bias, weights{', slope' if is_output else ''}"
        lines.append(f"    /* {name} */\n{wrap_items(texts[at : at + len(numbers)])}")
        at += len(numbers)
        if inputs:
            input_lines.append(
                f"    /* node {sensors + node} */\n{wrap_items([str(source) for source in inputs])}"
            )
    links = sum(map(len, sources))
    tables = (
        in_c.Table("weights", "float", len(texts), "\n".join(lines), controller.weights),
        in_c.Table("counts", kind, len(sources), wrap_items([str(len(inputs)) for inputs in sources])),
        in_c.Table("sources", kind, max(links, 1), "\n".join(input_lines) if links else "    0,"),
    )
    constants = {name: repr(number) for name, number in EXP.items()}
    actuator = in_c.actuator_function(0, 1, language).rstrip()
    kernel = render("c_nodes.txt", {**language, **constants, "actuator": actuator})
    return in_c.Code(
        tables,
        f"{in_c.double('a network of NEAT is computed', language)}\n{kernel}",
        step,
        f"    double outputs[{len(sources)}];",
        "the outputs of all nodes are kept from step to step",
    )


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    controller = Evolved(prune(controller.specification))
    specification = controller.specification
    sensors, sources = int(specification["sensors"]), specification["sources"]
    hidden = len(sources) - int(specification["actuators"])
    names = [f"_{name.upper()}" for name in EXP]
    lines = [
        "if 1.0 + 2.0**-52 == 1.0:",
        '    raise RuntimeError("a network of NEAT is computed with floats of 64 bits")',
        "",
        "# Of e to a power.",
        f"({', '.join(names)}) = {numbers(np.array(list(EXP.values())))}",
        "",
        "# Nodes: which nodes each hears, sensors first; a bias and weights, and for an actuator the slope.",
        "_NODES = (",
    ]
    for inputs, row, _ in iterate_nodes(specification, controller.weights):
        lines += ["    (", f"        {tuple(inputs)},", indent(f"{numbers(row)},", " " * 8), "    ),"]
    lines.append(")")
    step = [
        "outputs = self._outputs",
        f"for _ in range({int(specification['iterations'])}):",
        "    for node, (sources, row) in enumerate(_NODES):",
        "        total = 0.0",
        "        for place, source in enumerate(sources):",
        f"            heard = values[source] if source < {sensors} else outputs[source - {sensors}]",
        "            total = total + heard * row[1 + place]",
        "        total = total + row[0]",
        f"        if node < {hidden}:",
        "            outputs[node] = _hidden(total)",
        "        else:",
        "            outputs[node] = _output(row[1 + len(sources)], total)",
        "actuators = []",
        f"for output in outputs[{hidden}:]:",
        "    cell[0] = output",
        "    actuators.append(_actuator(cell[0], cell))",
        "return actuators",
    ]
    return in_python.PythonCode(
        "\n".join(lines),
        "\n\n".join([render("python_nodes.txt", {}), in_python.actuator_function(0, 1)]).rstrip("\n"),
        "",
        in_python.indent_method([f"self._outputs = [0.0] * {len(sources)}"]),
        in_python.indent_method(step),
        "the outputs of all nodes are kept from step to step",
        "from math import ldexp",
    )
