"""Source code of networks with Hebbian learning."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from swarmwright.controllers.kinds.fully_meshed.code import python as meshed_python
from swarmwright.controllers.source import Evolved, in_c, in_python
from swarmwright.controllers.source.text import literals, templates, wrap_items

render = templates(__file__)


def as_meshed(specification: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fully meshed network before learning, without the learning rate."""
    meshed = {"kind": "fully_meshed", "activation": "clamp", "output_range": [0.0, 1.0]}
    return {**specification, **meshed, "weights": list(specification["weights"][1:])}


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    meshed = as_meshed(controller.specification)
    sensors, hidden = int(meshed["sensors"]), int(meshed["hidden"])
    computed = hidden + int(meshed["actuators"])
    nodes = sensors + computed
    length = computed * (nodes + 1)
    function, check = in_c.overflow(language, computed)
    step = render(
        "c_step.txt",
        {
            **language,
            "words": f"{nodes} nodes",
            "nodes": str(nodes),
            "computed": str(computed),
            "length": str(length),
            "learning": str(max(computed * (nodes - 1), 1)),
            "above": str(sensors + hidden),
            "iterations": str(meshed["iterations"]),
            "refused": in_c.refusal_condition(language),
            "overflow": check,
        },
    )
    rows = [(f"node {sensors + node}", nodes + 1) for node in range(computed)]
    table = in_c.weights_table(controller.weights[1:], rows)
    rate = f"    /* learning rate */\n{wrap_items(literals(controller.weights[:1]))}"
    network = in_c.network(replace(controller, specification=meshed), language)
    return in_c.Code(
        (replace(table, length=length + 1, text=f"{rate}\n{table.text}", evolved=controller.weights),),
        f"{network.rstrip()}\n\n{in_c.double('what a network learns is computed', language)}\n"
        + render("c_learn.txt", language)
        + function,
        step,
        f"    float outputs[{nodes}];\n    float next[{computed}];\n    float links[{length}];",
        "the outputs of all nodes, and what the weights have become, are kept from step to step",
        in_c.OVERFLOW if check else "",
    )


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    meshed = replace(controller, specification=as_meshed(controller.specification))
    code = meshed_python(meshed, numbers)
    lines = [
        f"(_RATE,) = {numbers(controller.weights[:1])}",
        "if 1.0 + 2.0**-52 == 1.0:",
        '    raise RuntimeError("what a network learns is computed with floats of 64 bits")',
    ]
    hidden = int(meshed.specification["hidden"])
    step = [
        "outputs = self._outputs",
        f"for _ in range({int(meshed.specification['iterations'])}):",
        "    outputs = _layer(self._nodes, values + outputs, cell)",
        "self._outputs = outputs",
        *in_python.OVERFLOW,
        "_learn(self._nodes, _RATE, values + outputs, cell)",
        f"values = outputs[{hidden}:]",
        *in_python.RETURN_ACTUATORS,
    ]
    return replace(
        code,
        numbers=f"{code.numbers}\n\n# The learning rate.\n" + "\n".join(lines),
        functions=f"{code.functions}\n\n\n{render('python_learn.txt', {})}".rstrip("\n"),
        reset=f"{code.reset}\n" + in_python.indent_method(["self._nodes = [list(row) for row in _NODES]"]),
        step=in_python.indent_method(step),
        state_words="the outputs of all nodes, and what the weights have become, are kept from step to step",
    )
