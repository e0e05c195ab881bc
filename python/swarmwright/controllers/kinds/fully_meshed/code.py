"""Source code of fully meshed networks."""

from textwrap import indent

import numpy as np

from swarmwright.controllers.source import Evolved, in_c, in_onnx, in_python
from swarmwright.controllers.source.text import templates

render = templates(__file__)


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    specification = controller.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    nodes = sensors + computed
    function, check = in_c.overflow(language, computed)
    step = render(
        "c_step.txt",
        {
            **language,
            "words": f"{nodes} nodes, {specification['activation']}",
            "nodes": str(nodes),
            "computed": str(computed),
            "above": str(sensors + hidden),
            "iterations": str(specification["iterations"]),
            "refused": in_c.refusal_condition(language),
            "overflow": check,
        },
    )
    rows = [(f"node {sensors + node}", nodes + 1) for node in range(computed)]
    return in_c.Code(
        (in_c.weights_table(controller.weights, rows),),
        in_c.network(controller, language) + function,
        step,
        f"    float outputs[{nodes}];\n    float next[{computed}];",
        "the outputs of all nodes are kept from step to step",
        in_c.OVERFLOW if check else "",
    )


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    specification = controller.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    rows = controller.weights.reshape(computed, 1 + sensors + computed)
    lines = ["", "# Nodes: a bias, then a weight from every node, sensors first.", "_NODES = ("]
    lines += [*(indent(f"{numbers(row)},", "    ") for row in rows), ")"]
    step = [
        "outputs = self._outputs",
        f"for _ in range({int(specification['iterations'])}):",
        "    outputs = _layer(_NODES, values + outputs, cell)",
        "self._outputs = outputs",
        *in_python.OVERFLOW,
        f"values = outputs[{hidden}:]",
        *in_python.RETURN_ACTUATORS,
    ]
    return in_python.PythonCode(
        "\n".join([*in_python.constants(controller, numbers), *lines]),
        in_python.network(controller),
        "",
        in_python.indent_method([f"self._outputs = [0.0] * {computed}"]),
        in_python.indent_method(step),
        "the outputs of all nodes are kept from step to step",
        refuses="Raises it also when sensors are so large that a node overflows, and then until a reset.",
    )


def onnx(controller: Evolved, graph: in_onnx.Graph) -> None:
    """Add the controller to a graph of ONNX."""
    specification = controller.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    rows = controller.weights.reshape(computed, 1 + sensors + computed)
    outputs, iterations = "state", int(specification["iterations"])
    for _ in range(iterations):
        values = graph.add("Concat", "sensors", outputs, axis=1)
        outputs = in_onnx.layer(specification["activation"], graph, rows, values, "nodes")
    graph.add("Identity", outputs, result="next_state")
    columns = [graph.whole(number) for number in (hidden, computed, 1)]
    in_onnx.actuators(controller, graph, graph.add("Slice", outputs, *columns))
    graph.state = (np.float32, ["agents", computed])
    graph.initial_state = f"np.zeros((1, {computed}), np.float32)"
