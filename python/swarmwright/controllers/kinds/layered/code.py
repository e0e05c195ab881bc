"""Source code of layered networks."""

from collections.abc import Iterator
from itertools import pairwise
from textwrap import indent

from swarmwright.controllers.activations import describe_activations, find_activations
from swarmwright.controllers.source import Evolved, in_c, in_onnx, in_python
from swarmwright.controllers.source.text import templates

render = templates(__file__)


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    specification = controller.specification
    hidden = [int(nodes) for nodes in specification["hidden"]]
    sizes = [int(specification["sensors"]), *hidden, int(specification["actuators"])]
    odd, even = max(hidden[::2], default=0), max(hidden[1::2], default=0)
    words = "-".join(map(str, sizes))
    clear = render("c_clear.txt", {**language, "length": str(odd + even)}).rstrip()
    step = render(
        "c_step.txt",
        {
            **language,
            "words": f"{words}, {describe_activations(specification)}",
            "refused": in_c.refusal_condition(language),
            "clear": clear if hidden else "",
            "layers": "\n".join(_layers(controller, sizes, odd, language)),
        },
    )
    rows = [(f"layer {layer}, node {node}", below + 1) for layer, node, below in _nodes(sizes)]
    return in_c.Code(
        (in_c.weights_table(controller.weights, rows),),
        in_c.network(controller, language),
        step,
        f"    float work[{odd + even}];" if hidden else "",
        "this network remembers nothing from step to step"
        + ("; the array is what a step works with" if hidden else ""),
    )


def _nodes(sizes: list[int]) -> Iterator[tuple[int, int, int]]:
    for layer, (below, nodes) in enumerate(pairwise(sizes), 1):
        for node in range(nodes):
            yield layer, node, below


def _layers(controller: Evolved, sizes: list[int], odd: int, language: dict[str, str]) -> Iterator[str]:
    """Yield a call for each layer; hidden layers alternate between the two halves of the work space."""
    below, last = "sensors", len(sizes) - 2
    hidden, output = find_activations(controller.specification)
    work = f"{language['self']}work"
    for layer, (width, nodes) in enumerate(pairwise(sizes)):
        above = "actuators" if layer == last else f"{work} + {odd}" if layer % 2 and odd else work
        result = "(void)" if layer == last else "weights = "
        name = "output_layer" if layer == last and output != hidden else "layer"
        function = f"{language['detail']}{language['p']}_{name}"
        yield f"    {result}{function}(weights, {below}, {width}, {above}, {nodes});"
        below = above


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    specification = controller.specification
    sizes = [int(specification[name]) for name in ("sensors", "actuators")]
    sizes[1:1] = [int(nodes) for nodes in specification["hidden"]]
    lines, at = ["", "# Layers: for each node its bias and its weights.", "_LAYERS = ("], 0
    for below, nodes in pairwise(sizes):
        lines.append("    (")
        for _ in range(nodes):
            lines.append(indent(f"{numbers(controller.weights[at : at + below + 1])},", " " * 8))
            at += below + 1
        lines.append("    ),")
    lines.append(")")
    step = ["for rows in _LAYERS:", "    values = _layer(rows, values, cell)", *in_python.RETURN_ACTUATORS]
    if len(set(find_activations(specification))) > 1:
        step[0] = "for rows in _LAYERS[:-1]:"
        step.insert(2, "values = _output_layer(_LAYERS[-1], values, cell)")
    return in_python.PythonCode(
        "\n".join([*in_python.constants(controller, numbers), *lines]),
        in_python.network(controller),
        "",
        in_python.indent_method(["# This network remembers nothing."]),
        in_python.indent_method(step),
        "this network remembers nothing",
    )


def onnx(controller: Evolved, graph: in_onnx.Graph) -> None:
    """Add the controller to a graph of ONNX."""
    specification = controller.specification
    sizes = [int(specification[name]) for name in ("sensors", "actuators")]
    sizes[1:1] = [int(nodes) for nodes in specification["hidden"]]
    functions = find_activations(specification)
    values, at = "sensors", 0
    for number, (below, nodes) in enumerate(pairwise(sizes), 1):
        count = nodes * (below + 1)
        rows = controller.weights[at : at + count].reshape(nodes, below + 1)
        activation = functions[number == len(sizes) - 1]
        values = in_onnx.layer(activation, graph, rows, values, f"layer_{number}")
        at += count
    in_onnx.actuators(controller, graph, values)
