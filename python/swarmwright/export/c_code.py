"""Source code of controllers in C and C++: the arithmetic of decision 002, operation by operation."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from textwrap import indent

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import machine_texts, modules
from swarmwright.common.activations import in_words, of_nodes
from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.kinds.evostick.network import STEEP, as_layered
from swarmwright.controllers.kinds.hebbian.meshed import as_meshed
from swarmwright.controllers.kinds.neat.specification import EXP
from swarmwright.controllers.kinds.neat.specification import rows as neat_rows
from swarmwright.export._base import not_exported
from swarmwright.export.c_modules import own_code
from swarmwright.export.machine_tables import catalogue_of, machine_tables, machine_weights
from swarmwright.export.subject import Subject
from swarmwright.export.text import literals, render, wrapped

_TYPES = {16: "uint16_t", 32: "uint32_t"}


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


def code(subject: Subject, language: dict[str, str]) -> Code:
    """Return the code of a controller.

    Args:
        subject: that steers agents.
        language: replacements in templates that differ between C and C++.

    Raises:
        InputError: controllers of this kind are not known here.
    """
    make = _KINDS.get(subject.kind)
    if make is None:
        raise not_exported(subject, "C and C++", _KINDS)
    made = make(subject, language)
    ready = "    uint8_t ready; /* set by reset: without it, a step is refused */"
    return replace(made, state="\n".join(filter(None, [made.state, ready])))


def _refused(language: Mapping[str, str], states: int = 0, beyond: str = "") -> str:
    """Return the condition in which a step changes nothing; states: how many there are, of a machine."""
    own, function = language["self"], f"{language['detail']}{language['p']}_finite"
    parts = [f"{own}ready != {language['PREFIX']}_READY"]
    if states:
        parts.append(f"{own}state >= {states}")
    parts.append(f"!{function}(sensors)")
    return " || ".join([*parts, *([beyond] if beyond else [])])


def _overflow(language: Mapping[str, str], computed: int) -> tuple[str, str]:
    """Return the function that notices an overflow, and what a step does then.

    Both are empty for controllers inside of simulations, which act as the engine's do.
    """
    if language.get("loaded"):
        return "", ""
    values = {**language, "computed": str(computed)}
    return render("c_overflow.txt", language), render("c_overflow_check.txt", values).rstrip()


_OVERFLOW = (
    "It also returns false, with the actuators as before, when sensors are so large that a node overflows to "
    "NaN, and then until the next reset."
)
_OUTSIDE = "So it does when the sensor random is not from 0 to 1."


def _layered(subject: Subject, language: dict[str, str]) -> Code:
    specification = subject.specification
    hidden = [int(nodes) for nodes in specification["hidden"]]
    sizes = [int(specification["sensors"]), *hidden, int(specification["actuators"])]
    odd, even = max(hidden[::2], default=0), max(hidden[1::2], default=0)
    words = "-".join(map(str, sizes))
    clear = render("c_clear.txt", {**language, "length": str(odd + even)}).rstrip()
    step = render(
        "c_step_layered.txt",
        {
            **language,
            "words": f"{words}, {in_words(specification)}",
            "refused": _refused(language),
            "clear": clear if hidden else "",
            "layers": "\n".join(_layers(subject, sizes, odd, language)),
        },
    )
    rows = [(f"layer {layer}, node {node}", below + 1) for layer, node, below in _nodes(sizes)]
    return Code(
        (_weights(subject.weights, rows),),
        _network(subject, language),
        step,
        f"    float work[{odd + even}];" if hidden else "",
        "this network remembers nothing from step to step"
        + ("; the array is what a step works with" if hidden else ""),
    )


def _evostick(subject: Subject, language: dict[str, str]) -> Code:
    return _layered(replace(subject, specification=as_layered(subject.specification)), language)


def _nodes(sizes: list[int]) -> Iterator[tuple[int, int, int]]:
    for layer, (below, nodes) in enumerate(pairwise(sizes), 1):
        for node in range(nodes):
            yield layer, node, below


def _layers(subject: Subject, sizes: list[int], odd: int, language: dict[str, str]) -> Iterator[str]:
    """Yield a call for each layer; hidden ones take turns with the two parts of the work space."""
    below, last = "sensors", len(sizes) - 2
    hidden, output = of_nodes(subject.specification)
    work = f"{language['self']}work"
    for layer, (width, nodes) in enumerate(pairwise(sizes)):
        above = "actuators" if layer == last else f"{work} + {odd}" if layer % 2 and odd else work
        result = "(void)" if layer == last else "weights = "
        name = "output_layer" if layer == last and output != hidden else "layer"
        function = f"{language['detail']}{language['p']}_{name}"
        yield f"    {result}{function}(weights, {below}, {width}, {above}, {nodes});"
        below = above


def _fully_meshed(subject: Subject, language: dict[str, str]) -> Code:
    specification = subject.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    nodes = sensors + computed
    function, check = _overflow(language, computed)
    step = render(
        "c_step_fully_meshed.txt",
        {
            **language,
            "words": f"{nodes} nodes, {specification['activation']}",
            "nodes": str(nodes),
            "computed": str(computed),
            "above": str(sensors + hidden),
            "iterations": str(specification["iterations"]),
            "refused": _refused(language),
            "overflow": check,
        },
    )
    rows = [(f"node {sensors + node}", nodes + 1) for node in range(computed)]
    return Code(
        (_weights(subject.weights, rows),),
        _network(subject, language) + function,
        step,
        f"    float outputs[{nodes}];\n    float next[{computed}];",
        "the outputs of all nodes are kept from step to step",
        _OVERFLOW if check else "",
    )


def _hebbian(subject: Subject, language: dict[str, str]) -> Code:
    meshed = as_meshed(subject.specification)
    sensors, hidden = int(meshed["sensors"]), int(meshed["hidden"])
    computed = hidden + int(meshed["actuators"])
    nodes = sensors + computed
    length = computed * (nodes + 1)
    function, check = _overflow(language, computed)
    step = render(
        "c_step_hebbian.txt",
        {
            **language,
            "words": f"{nodes} nodes",
            "nodes": str(nodes),
            "computed": str(computed),
            "length": str(length),
            "learning": str(max(computed * (nodes - 1), 1)),
            "above": str(sensors + hidden),
            "iterations": str(meshed["iterations"]),
            "refused": _refused(language),
            "overflow": check,
        },
    )
    rows = [(f"node {sensors + node}", nodes + 1) for node in range(computed)]
    table = _weights(subject.weights[1:], rows)
    rate = f"    /* learning rate */\n{wrapped(literals(subject.weights[:1]))}"
    network = _network(replace(subject, specification=meshed), language)
    return Code(
        (replace(table, length=length + 1, text=f"{rate}\n{table.text}", evolved=subject.weights),),
        f"{network.rstrip()}\n\n{_double('what a network learns is computed', language)}\n"
        + render("c_hebbian.txt", language)
        + function,
        step,
        f"    float outputs[{nodes}];\n    float next[{computed}];\n    float links[{length}];",
        "the outputs of all nodes, and what the weights have become, are kept from step to step",
        _OVERFLOW if check else "",
    )


def _neat(subject: Subject, language: dict[str, str]) -> Code:
    specification = subject.specification
    sensors, sources = int(specification["sensors"]), specification["sources"]
    hidden = len(sources) - int(specification["actuators"])
    bits = 16 if sensors + len(sources) < 1 << 16 and max(map(len, sources)) < 1 << 16 else 32
    kind = _TYPES[bits]
    step = render(
        "c_step_neat.txt",
        {
            **language,
            "words": f"{hidden} hidden nodes",
            "computed": str(len(sources)),
            "hidden": str(hidden),
            "iterations": str(specification["iterations"]),
            "refused": _refused(language),
            "type": kind,
            "bits": str(bits),
        },
    )
    texts, lines, seen_by = literals(subject.weights), [], []
    at = 0
    for node, (seen, numbers, is_output) in enumerate(neat_rows(specification, subject.weights)):
        name = f"node {sensors + node}: bias, weights{', slope' if is_output else ''}"
        lines.append(f"    /* {name} */\n{wrapped(texts[at : at + len(numbers)])}")
        at += len(numbers)
        if seen:
            seen_by.append(f"    /* node {sensors + node} */\n{wrapped([str(one) for one in seen])}")
    links = sum(map(len, sources))
    tables = (
        Table("weights", "float", len(texts), "\n".join(lines), subject.weights),
        Table("counts", kind, len(sources), wrapped([str(len(seen)) for seen in sources])),
        Table("sources", kind, max(links, 1), "\n".join(seen_by) if links else "    0,"),
    )
    constants = {name: repr(number) for name, number in EXP.items()}
    actuator = _actuator_function(0, 1, language).rstrip()
    kernel = render("c_neat.txt", {**language, **constants, "actuator": actuator})
    return Code(
        tables,
        f"{_double('a network of NEAT is computed', language)}\n{kernel}",
        step,
        f"    double outputs[{len(sources)}];",
        "the outputs of all nodes are kept from step to step",
    )


def _weights(weights: NDArray[np.float32], rows: list[tuple[str, int]]) -> Table:
    """Return the table of weights; rows: a node's name and how many numbers it has."""
    texts = literals(weights)
    lines, at = [], 0
    for name, count in rows:
        lines.append(f"    /* {name}: bias, weights */\n{wrapped(texts[at : at + count])}")
        at += count
    return Table("weights", "float", len(texts), "\n".join(lines), weights)


def _network(subject: Subject, language: dict[str, str]) -> str:
    hidden, output = of_nodes(subject.specification)
    functions = []
    if {hidden, output} & {"tanh", "sigmoid", STEEP}:
        functions.append(render("c_tanh.txt", language))
    functions.append(_layer_function(hidden, "", language))
    if output != hidden:
        functions.append(_layer_function(output, "output_", language))
    low, high = subject.specification["output_range"]
    functions.append(_actuator_function(float(low), float(high), language))
    return "\n".join(functions)


def _layer_function(activation: str, which: str, language: dict[str, str]) -> str:
    values = {**language, "which": which}
    return "\n".join(render(name, values) for name in (f"c_activation_{activation}.txt", "c_network.txt"))


def _actuator_function(low: float, high: float, language: dict[str, str]) -> str:
    words, lines = _actuator(low, high, language)
    return render("c_actuator.txt", {**language, "output_range": words, "actuator": lines})


def _double(what: str, language: dict[str, str]) -> str:
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
    first, last = (shortest_decimal(float(one)) for one in bounds)
    return f"{first}..{last} becomes -1..1", "\n".join(f"    {line}" for line in lines)


def _mealy_fsm(subject: Subject, language: dict[str, str]) -> Code:
    thresholds = [np.array(of_one, np.float32) for of_one in subject.specification["thresholds"]]
    counts = [len(of_one) for of_one in thresholds]
    states, outputs = machine_tables(subject)
    bits = 16 if max([int(subject.specification["states"]), *counts]) < 1 << 16 else 32
    tables = [
        Table(
            "next",
            _TYPES[bits],
            len(states),
            wrapped([str(one) for one in states.tolist()]),
            states.astype(np.uint32),
        ),
        Table("outputs", "float", outputs.size, wrapped(literals(outputs.reshape(-1))), outputs.reshape(-1)),
    ]
    if any(counts):
        tables.append(Table("counts", _TYPES[bits], len(counts), wrapped([str(one) for one in counts])))
        lines = [
            f"    /* sensor {sensor} */\n{wrapped(literals(of_one))}"
            for sensor, of_one in enumerate(thresholds)
            if len(of_one)
        ]
        tables.append(Table("thresholds", "float", sum(counts), "\n".join(lines)))
    part = {**language, "count_type": _TYPES[bits], "bits": str(bits)}
    step = render(
        "c_step_mealy_fsm.txt",
        {
            **language,
            "next_bits": str(bits),
            "refused": _refused(language, int(subject.specification["states"])),
            "locals": render("c_row_locals.txt", part).rstrip() if any(counts) else "",
            "row": render("c_row.txt", part).rstrip() if any(counts) else "",
        },
    )
    return Code(tuple(tables), "", step, f"    {_TYPES[bits]} state;", "the number of the state")


def _modules(subject: Subject, language: dict[str, str]) -> Code:
    states, most = modules.states_of(subject.specification), int(subject.specification["transitions"])
    tree = modules.is_tree(subject.specification)
    weights = machine_weights(subject)
    texts = literals(weights)
    name = "subtree" if tree else "state"
    known = catalogue_of(subject.specification)
    own = own_code(known, language, tree=tree, transitions=most)
    first, each = known.of_state, known.of_transition
    width = first + most * each
    of_states, of_transitions = (
        "".join(f", {one.name} {name}" for one in many if not one.built_in for name in one.parameters)
        for many in (known.behaviours, known.conditions)
    )
    lines = [f"    /* number of {name}s */", wrapped(texts[:1])]
    for index in range(int(subject.specification["states"])):
        row = texts[1 + index * width :][:width]
        words = machine_texts.words_of(states[index]) if index < len(states) else "not used"
        lines.append(f"    /* {name} {index}, {words}: behaviour, rwm, alpha, transitions{of_states} */")
        lines.append(wrapped(row[:first]))
        for k in range(most):
            here = first + k * each
            used = index < len(states) and k < len(states[index].transitions)
            words = machine_texts.words_of(states[index].transitions[k]) if used else "not used"
            if used and tree:
                words = f"next subtree if {machine_texts.condition_words(states[index])}"
            lines.append(f"    /* {words}: target, condition, probability, xi, eta{of_transitions} */")
            lines.append(wrapped(row[here : here + each]))
    activation = "\n".join(
        render(f"c_{name}.txt", {**language, "which": ""}) for name in ("tanh", "activation_sigmoid")
    )
    checks = subject.checks_random and not language.get("loaded")
    outside = "!(sensors[8] >= 0.0f && sensors[8] <= 1.0f)" if checks else ""
    step = render(
        "c_step_tree.txt" if tree else "c_step_modules.txt",
        {
            **language,
            "words": f"{len(states)} {name}s",
            "width": str(width),
            "first": str(first),
            "each": str(each),
            "refused": _refused(language, len(states), outside),
            **own.calls,
            "forget_within": indent(own.calls["forget"], "    "),
            **({"count": str(len(states))} if tree else {"transitions": str(most)}),
        },
    )
    kept = ("    uint8_t state;", "    uint8_t settled;", "    int8_t turn;")
    kernel = render("c_modules.txt", {**language, "activation": activation.rstrip()})
    words = (
        "the number of the subtree, and how long the robot still turns"
        if tree
        else "the number of the state, whether it was entered before, and how long the robot still turns"
    )
    return Code(
        (Table("weights", "float", len(texts), "\n".join(lines), weights),),
        f"{kernel}\n{own.kernel}" if own.kernel else kernel,
        step,
        "\n".join([*((kept[0], kept[2]) if tree else kept), *own.members]),
        f"{words}; what its modules remember" if own.members else words,
        _OUTSIDE if outside else "",
    )


_KINDS: dict[str, Callable[[Subject, dict[str, str]], Code]] = {
    "evostick": _evostick,
    "fully_meshed": _fully_meshed,
    "hebbian": _hebbian,
    "layered": _layered,
    "mealy_fsm": _mealy_fsm,
    "neat": _neat,
    modules.KIND: _modules,
    modules.PYTHON_KIND: _modules,
}
