"""Source code of state machines."""

from textwrap import indent

import numpy as np

from swarmwright.controllers.kinds.mealy_fsm.tables import machine_tables
from swarmwright.controllers.source import Evolved, in_c, in_onnx, in_python
from swarmwright.controllers.source.text import literals, templates, wrap_items

render = templates(__file__)


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    thresholds = [np.array(edges, np.float32) for edges in controller.specification["thresholds"]]
    counts = [len(edges) for edges in thresholds]
    states, outputs = machine_tables(controller)
    bits = 16 if max([int(controller.specification["states"]), *counts]) < 1 << 16 else 32
    tables = [
        in_c.Table(
            "next",
            in_c.TYPES[bits],
            len(states),
            wrap_items([str(state) for state in states.tolist()]),
            states.astype(np.uint32),
        ),
        in_c.Table(
            "outputs", "float", outputs.size, wrap_items(literals(outputs.reshape(-1))), outputs.reshape(-1)
        ),
    ]
    if any(counts):
        tables.append(
            in_c.Table("counts", in_c.TYPES[bits], len(counts), wrap_items([str(count) for count in counts]))
        )
        lines = [
            f"    /* sensor {sensor} */\n{wrap_items(literals(edges))}"
            for sensor, edges in enumerate(thresholds)
            if len(edges)
        ]
        tables.append(in_c.Table("thresholds", "float", sum(counts), "\n".join(lines)))
    part = {**language, "count_type": in_c.TYPES[bits], "bits": str(bits)}
    step = render(
        "c_step.txt",
        {
            **language,
            "next_bits": str(bits),
            "refused": in_c.refusal_condition(language, int(controller.specification["states"])),
            "locals": render("c_row_locals.txt", part).rstrip() if any(counts) else "",
            "row": render("c_row.txt", part).rstrip() if any(counts) else "",
        },
    )
    return in_c.Code(tuple(tables), "", step, f"    {in_c.TYPES[bits]} state;", "the number of the state")


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    thresholds = [np.array(edges, np.float32) for edges in controller.specification["thresholds"]]
    states, outputs = machine_tables(controller)
    lines = ["# Where the intervals of each sensor end.", "_THRESHOLDS = ("]
    lines += [indent(f"{numbers(edges) if len(edges) else '()'},", "    ") for edges in thresholds]
    lines += [")", ""]
    width = outputs.shape[1]
    next_states = states.astype(np.uint16) if states.max() < 1 << 16 else states.astype(np.uint32)
    lines += [
        "# For each state and interval of the sensors: the state of the next step, and the actuators.",
        f"_NEXT = {numbers(next_states)}",
        f"_ACTUATORS = {numbers(outputs.reshape(-1))}",
    ]
    step = [
        "row = self._state",
        "for value, thresholds in zip(values, _THRESHOLDS):",
        "    row *= len(thresholds) + 1",
        "    for threshold in thresholds:",
        "        row += threshold < value",
        "self._state = _NEXT[row]",
        f"return list(_ACTUATORS[row * {width} : row * {width} + {width}])",
    ]
    return in_python.PythonCode(
        "\n".join(lines),
        "",
        "",
        in_python.indent_method(["self._state = 0"]),
        in_python.indent_method(step),
        "the number of the state is kept from step to step",
    )


def onnx(controller: Evolved, graph: in_onnx.Graph) -> None:
    """Add the controller to a graph of ONNX."""
    thresholds = [np.array(edges, np.float32) for edges in controller.specification["thresholds"]]
    most = max(1, *(len(edges) for edges in thresholds))
    # No sensor is above infinity.
    padded = np.array([np.pad(edges, (0, most - len(edges)), constant_values=np.inf) for edges in thresholds])
    counts = [len(edges) + 1 for edges in thresholds]
    radix = np.array([int(np.prod(counts[index + 1 :])) for index in range(len(counts))], np.int64)
    graph.largest_tensor_elements = most * len(counts)
    column = graph.add("Unsqueeze", "sensors", graph.whole(2))
    over = graph.add("Less", graph.constant(padded.astype(np.float32), "thresholds"), column)
    # A selection and one sum: OpenVINO 2026.4 miscomputes a product behind a sum over an axis of length 1.
    place_values = np.broadcast_to(radix[:, np.newaxis], padded.shape)
    digits = graph.add(
        "Where", over, graph.constant(place_values, "radix"), graph.constant(np.array(0, np.int64), "none")
    )
    symbol = graph.add("ReduceSum", digits, graph.whole(1, 2), keepdims=0)
    state_offset = graph.add("Mul", "state", graph.constant(np.array(np.prod(counts), np.int64), "symbols"))
    row = graph.add("Add", state_offset, symbol)
    states, outputs = machine_tables(controller)
    graph.add("Gather", graph.constant(states, "next_states"), row, result="next_state")
    graph.add("Gather", graph.constant(outputs, "outputs"), row, result="actuators", axis=0)
    graph.state = (np.int64, ["agents"])
    graph.initial_state = "np.zeros(1, np.int64)"
