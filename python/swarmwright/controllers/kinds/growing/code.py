"""Source code of growing networks, with the genes that are in use alone."""

from textwrap import indent

import numpy as np

from swarmwright.controllers.activations import STEEP, STEEPNESS
from swarmwright.controllers.kinds.growing.genes import Genes, read, words
from swarmwright.controllers.source import Evolved, in_c, in_onnx, in_python
from swarmwright.controllers.source.text import literals, templates, wrap_items

render = templates(__file__)

_SMOOTH = {"tanh", "sigmoid", STEEP}
"""Activation functions that are computed from the hyperbolic tangent."""


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    genes = read(controller.specification)
    nodes, weights = genes.nodes, genes.weights
    largest = max(genes.sensors + 1 + len(nodes), len(weights))
    bits = 16 if largest < 1 << 16 else 32
    kind = in_c.TYPES[bits]
    step = render(
        "c_step.txt",
        {
            **language,
            "words": f"{genes.hidden} hidden nodes, {words(genes)}",
            "computed": str(len(nodes)),
            "hidden": str(genes.hidden),
            "first": str(genes.sensors + 1),
            "refused": in_c.refusal_condition(language),
            "type": kind,
            "bits": str(bits),
            "written": "next" if genes.recurrent else "outputs",
            "copy": render("c_copy.txt", {**language, "computed": str(len(nodes))}).rstrip()
            if genes.recurrent
            else "",
        },
    )
    sources = [str(source) for node in nodes for source in node.sources]
    rows = [(f"node {genes.sensors + 1 + index}", len(node.weights)) for index, node in enumerate(nodes)]
    tables = (
        in_c.Table("weights", "float", max(len(weights), 1), _weights(genes, rows) or "    0.0f,", weights),
        _table("counts", kind, [str(len(node.sources)) for node in nodes]),
        _table("sources", kind, sources or ["0"]),
        _table("functions", kind, [str(genes.activations.index(node.activation)) for node in nodes]),
    )
    return in_c.Code(
        tables,
        _kernel(genes, controller, language),
        step,
        "\n".join(
            f"    float {name}[{len(nodes)}];" for name in ("outputs", *(["next"] if genes.recurrent else []))
        ),
        "the outputs of all nodes are kept from step to step"
        if genes.recurrent
        else "the outputs of all nodes",
    )


def _table(name: str, kind: str, items: list[str]) -> in_c.Table:
    return in_c.Table(name, kind, len(items), wrap_items(items))


def _weights(genes: Genes, rows: list[tuple[str, int]]) -> str:
    texts, lines, at = literals(genes.weights), [], 0
    for name, count in rows:
        if count:
            lines.append(f"    /* {name} */\n{wrap_items(texts[at : at + count])}")
        at += count
    return "\n".join(lines)


def _kernel(genes: Genes, controller: Evolved, language: dict[str, str]) -> str:
    """Return the activation functions, one that calls them by number, and that of actuators."""
    parts = [in_c.render("c_tanh.txt", language)] if _SMOOTH & set(genes.activations) else []
    parts += [
        in_c.render(f"c_activation_{name}.txt", {**language, "which": f"{name}_"})
        for name in genes.activations
    ]
    *others, last = (f"{language['p']}_{name}_activation(a)" for name in genes.activations)
    cases = "".join(f"function == {number} ? {call} : " for number, call in enumerate(others))
    parts.append(
        render(
            "c_activation.txt",
            {**language, "result": f"{cases}{last}", "unused": "" if others else "(void)function;"},
        )
    )
    low, high = controller.specification["output_range"]
    parts.append(in_c.actuator_function(float(low), float(high), language))
    return "\n".join(parts)


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    genes = read(controller.specification)
    constants = in_python.tanh_constants(numbers) if _SMOOTH & set(genes.activations) else []
    if STEEP in genes.activations:
        constants.append(f"(_STEEPNESS,) = {numbers(np.array([STEEPNESS], np.float32))}")
    low, high = np.array(controller.specification["output_range"], np.float32)
    if (low, high) not in ((-1, 1), (0, 1)):
        constants.append(f"_LOW, _WIDTH = {numbers(np.array([low, high - low], np.float32))}")
    functions = [in_python.render("python_tanh.txt", {})] if _SMOOTH & set(genes.activations) else []
    functions += [
        f"def _activate_{name}(a, cell):\n{in_python.ACTIVATIONS[name]}\n" for name in genes.activations
    ]
    functions.append(in_python.actuator_function(*controller.specification["output_range"]))
    lines = [
        *constants,
        "",
        "# Nodes: their function, the nodes of their connections, and the weights.",
        "_NODES = (",
    ]
    for node in genes.nodes:
        row = numbers(node.weights) if len(node.weights) else "()"
        sources = "".join(f"{source}, " for source in node.sources).rstrip(" ")
        lines += [
            f"    ({genes.activations.index(node.activation)}, ({sources}), (",
            indent(f"{row}", " " * 8),
            "    )),",
        ]
    lines.append(")")
    names = ", ".join(f"_activate_{name}" for name in genes.activations)
    first = genes.sensors + 1
    written = "nodes" if genes.recurrent else "outputs"
    step = [
        f"functions = ({names},)",
        "values = values + [1.0]",
        "outputs = self._outputs",
        *(["nodes = list(outputs)"] if genes.recurrent else []),
        "for node, (function, sources, row) in enumerate(_NODES):",
        "    total = 0.0",
        "    for place, source in enumerate(sources):",
        f"        value = values[source] if source < {first} else outputs[source - {first}]",
        "        cell[0] = row[place] * value",
        "        cell[0] = total + cell[0]",
        "        total = cell[0]",
        f"    {written}[node] = functions[function](total, cell)",
        *(["self._outputs = nodes"] if genes.recurrent else []),
        f"values = {written}[{genes.hidden}:]",
        *in_python.RETURN_ACTUATORS,
    ]
    return in_python.PythonCode(
        "\n".join(lines),
        "\n\n".join(functions).rstrip("\n"),
        "",
        in_python.indent_method([f"self._outputs = [0.0] * {len(genes.nodes)}"]),
        in_python.indent_method(step),
        "the outputs of all nodes are kept from step to step" if genes.recurrent else "",
    )


def onnx(controller: Evolved, graph: in_onnx.Graph) -> None:
    """Add the controller to a graph of ONNX."""
    genes = read(controller.specification)
    bias = graph.add("Slice", "sensors", *(graph.whole(number) for number in (0, 1, 1)))
    ones = graph.add("Add", graph.add("Mul", bias, graph.number(0)), graph.number(1))
    columns = [
        graph.add("Slice", "sensors", *(graph.whole(at) for at in (sensor, sensor + 1, 1)))
        for sensor in range(genes.sensors)
    ]
    columns.append(ones)
    computed = len(genes.nodes)
    before = (
        [
            graph.add("Slice", "state", *(graph.whole(at) for at in (node, node + 1, 1)))
            for node in range(computed)
        ]
        if genes.recurrent
        else []
    )
    outputs: list[str] = []
    for rank, node in enumerate(genes.nodes):
        inputs = [*columns, *(before or outputs)]
        if node.sources:
            below = graph.add("Concat", *(inputs[source] for source in node.sources), axis=1)
            rows = np.concatenate([[0.0], node.weights]).astype(np.float32)[np.newaxis]
            outputs.append(in_onnx.layer(node.activation, graph, rows, below, f"node_{rank}"))
        else:
            zero = graph.add("Mul", ones, graph.number(0))
            outputs.append(in_onnx.ACTIVATIONS[node.activation](graph, zero))
    if genes.recurrent:
        graph.add("Concat", *outputs, axis=1, result="next_state")
        graph.state = (np.float32, ["agents", computed])
        graph.initial_state = f"np.zeros((1, {computed}), np.float32)"
    in_onnx.actuators(controller, graph, graph.add("Concat", *outputs[genes.hidden :], axis=1))
