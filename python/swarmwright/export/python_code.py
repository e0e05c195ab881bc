"""Source code of controllers in Python and MicroPython: the arithmetic of decision 002.

Numbers of Python have 64 bits, those of MicroPython 64 or 32. A result of one operation on two binary32
that is computed in binary64 and then rounded to binary32 is the correctly rounded one, for +, -, * and /.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from textwrap import indent

import numpy as np

from swarmwright.common import machine_texts, modules
from swarmwright.common.activations import of_nodes
from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.kinds.evostick.network import STEEP, STEEPNESS, as_layered
from swarmwright.controllers.kinds.hebbian.meshed import as_meshed
from swarmwright.controllers.kinds.neat.specification import EXP
from swarmwright.controllers.kinds.neat.specification import rows as neat_rows
from swarmwright.export._base import not_exported
from swarmwright.export.machine_tables import catalogue_of, machine_tables, machine_weights
from swarmwright.export.python_arrays import Numbers
from swarmwright.export.python_modules import has_own
from swarmwright.export.subject import Subject
from swarmwright.export.text import render

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
    """What is kept from step to step, in words."""
    imports: str = ""
    """Lines, besides those that every module has."""
    refuses: str = ""
    """A sentence on when a step raises ValueError, besides for other sensors than finite numbers."""


def python_code(subject: Subject, numbers: Numbers) -> PythonCode:
    """Return the code of a controller that steers agents. Raises InputError for an unknown kind."""
    make = _KINDS.get(subject.kind)
    if make is None:
        raise not_exported(subject, "Python", _KINDS)
    return make(subject, numbers)


def _layered(subject: Subject, numbers: Numbers) -> PythonCode:
    specification = subject.specification
    sizes = [int(specification[name]) for name in ("sensors", "actuators")]
    sizes[1:1] = [int(nodes) for nodes in specification["hidden"]]
    lines, at = ["", "# Layers: for each node its bias and its weights.", "_LAYERS = ("], 0
    for below, nodes in pairwise(sizes):
        lines.append("    (")
        for _ in range(nodes):
            lines.append(indent(f"{numbers(subject.weights[at : at + below + 1])},", " " * 8))
            at += below + 1
        lines.append("    ),")
    lines.append(")")
    step = ["for rows in _LAYERS:", "    values = _layer(rows, values, cell)", *_ACTUATORS]
    if len(set(of_nodes(specification))) > 1:
        step[0] = "for rows in _LAYERS[:-1]:"
        step.insert(2, "values = _output_layer(_LAYERS[-1], values, cell)")
    return PythonCode(
        "\n".join([*_constants(subject, numbers), *lines]),
        _network(subject, numbers),
        "",
        _indented(["# This network remembers nothing."]),
        _indented(step),
        "this network remembers nothing",
    )


def _evostick(subject: Subject, numbers: Numbers) -> PythonCode:
    return _layered(replace(subject, specification=as_layered(subject.specification)), numbers)


def _fully_meshed(subject: Subject, numbers: Numbers) -> PythonCode:
    specification = subject.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    rows = subject.weights.reshape(computed, 1 + sensors + computed)
    lines = ["", "# Nodes: a bias, then a weight from every node, sensors first.", "_NODES = ("]
    lines += [*(indent(f"{numbers(row)},", "    ") for row in rows), ")"]
    step = [
        "outputs = self._outputs",
        f"for _ in range({int(specification['iterations'])}):",
        "    outputs = _layer(_NODES, values + outputs, cell)",
        "self._outputs = outputs",
        *_OVERFLOW,
        f"values = outputs[{hidden}:]",
        *_ACTUATORS,
    ]
    return PythonCode(
        "\n".join([*_constants(subject, numbers), *lines]),
        _network(subject, numbers),
        "",
        _indented([f"self._outputs = [0.0] * {computed}"]),
        _indented(step),
        "the outputs of all nodes are kept from step to step",
        refuses="Raises it also when sensors are so large that a node overflows, and then until a reset.",
    )


def _hebbian(subject: Subject, numbers: Numbers) -> PythonCode:
    meshed = replace(subject, specification=as_meshed(subject.specification))
    code = _fully_meshed(meshed, numbers)
    lines = [
        f"(_RATE,) = {numbers(subject.weights[:1])}",
        "if 1.0 + 2.0**-52 == 1.0:",
        '    raise RuntimeError("what a network learns is computed with floats of 64 bits")',
    ]
    hidden = int(meshed.specification["hidden"])
    step = [
        "outputs = self._outputs",
        f"for _ in range({int(meshed.specification['iterations'])}):",
        "    outputs = _layer(self._nodes, values + outputs, cell)",
        "self._outputs = outputs",
        *_OVERFLOW,
        "_learn(self._nodes, _RATE, values + outputs, cell)",
        f"values = outputs[{hidden}:]",
        *_ACTUATORS,
    ]
    return replace(
        code,
        numbers=f"{code.numbers}\n\n# The learning rate.\n" + "\n".join(lines),
        functions=f"{code.functions}\n\n\n{render('python_hebbian.txt', {})}".rstrip("\n"),
        reset=f"{code.reset}\n" + _indented(["self._nodes = [list(row) for row in _NODES]"]),
        step=_indented(step),
        state_words="the outputs of all nodes, and what the weights have become, are kept from step to step",
    )


def _neat(subject: Subject, numbers: Numbers) -> PythonCode:
    specification = subject.specification
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
    for seen, row, _ in neat_rows(specification, subject.weights):
        lines += ["    (", f"        {tuple(seen)},", indent(f"{numbers(row)},", " " * 8), "    ),"]
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
    return PythonCode(
        "\n".join(lines),
        "\n\n".join([render("python_neat.txt", {}), _actuator_function(0, 1)]).rstrip("\n"),
        "",
        _indented([f"self._outputs = [0.0] * {len(sources)}"]),
        _indented(step),
        "the outputs of all nodes are kept from step to step",
        "from math import ldexp",
    )


_OVERFLOW = [
    "if any(output != output for output in outputs):",
    '    raise ValueError("a node has overflowed, sensors were too large: reset the controller")',
]
_ACTUATORS = ["return [_actuator(value, cell) for value in values]"]


def _indented(lines: list[str]) -> str:
    return "\n".join(f"        {line}" for line in lines)


def _constants(subject: Subject, numbers: Numbers) -> list[str]:
    lines = []
    functions = set(of_nodes(subject.specification))
    if functions & {"tanh", "sigmoid", STEEP}:
        lines += _tanh_constants(numbers)
    if STEEP in functions:
        lines.append(f"(_STEEPNESS,) = {numbers(np.array([STEEPNESS], np.float32))}")
    low, high = np.array(subject.specification["output_range"], np.float32)
    if (low, high) not in ((-1, 1), (0, 1)):
        lines.append(f"_LOW, _WIDTH = {numbers(np.array([low, high - low], np.float32))}")
    return lines


def _tanh_constants(numbers: Numbers) -> list[str]:
    values = np.array(list(_TANH.values()), np.float32)
    return [f"{', '.join(f'_{name}' for name in _TANH)} = {numbers(values)}"]


def _network(subject: Subject, numbers: Numbers) -> str:  # noqa: ARG001 - as the others
    hidden, output = of_nodes(subject.specification)
    parts = [render("python_tanh.txt", {})] if {hidden, output} & {"tanh", "sigmoid", STEEP} else []
    for activation, which in ((hidden, ""), (output, "output_"))[: 1 if hidden == output else 2]:
        parts.append(f"def _{which}activation(a, cell):\n{_ACTIVATIONS[activation]}\n")
        parts.append(render("python_network.txt", {"which": which}))
    parts.append(_actuator_function(*subject.specification["output_range"]))
    return "\n\n".join(parts).rstrip("\n")


def _actuator_function(*output_range: float) -> str:
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


_ACTIVATIONS = {
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


def _mealy_fsm(subject: Subject, numbers: Numbers) -> PythonCode:
    thresholds = [np.array(of_one, np.float32) for of_one in subject.specification["thresholds"]]
    states, outputs = machine_tables(subject)
    lines = ["# Where the intervals of each sensor end.", "_THRESHOLDS = ("]
    lines += [indent(f"{numbers(of_one) if len(of_one) else '()'},", "    ") for of_one in thresholds]
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
    return PythonCode(
        "\n".join(lines),
        "",
        "",
        _indented(["self._state = 0"]),
        _indented(step),
        "the number of the state is kept from step to step",
    )


def _modules(subject: Subject, numbers: Numbers) -> PythonCode:
    weights, most = machine_weights(subject), int(subject.specification["transitions"])
    known, own = catalogue_of(subject.specification), has_own(subject)
    states, tree = modules.states_of(subject.specification), modules.is_tree(subject.specification)
    limits = np.array([0.1, 0.1, 0.95, 1 - 2**-24], np.float32)
    lines = [
        *_tanh_constants(numbers),
        f"_SHORT, _BLACK, _WHITE, _MOST = {numbers(limits)}",
        "",
        f"# {'Subtrees' if tree else 'States'}: behaviour, rwm, alpha; transitions: target, condition, ..",
        "_STATES = (",
    ]
    at = 1
    for index, state in enumerate(states):
        lines.append(f"    # {'subtree' if tree else 'state'} {index}: {machine_texts.words_of(state)}")
        row = weights[at : at + (known.of_state if own else 3)]
        lines += ["    (", indent(f"{numbers(row)},", " " * 8), "        ("]
        for k, one in enumerate(state.transitions):
            here = at + known.of_state + k * known.of_transition
            words = (
                f"next subtree if {machine_texts.condition_words(state)}"
                if tree
                else machine_texts.words_of(one)
            )
            lines.append(f"            # {words}")
            lines.append(indent(f"{numbers(weights[here : here + known.of_transition])},", " " * 12))
        lines += ["        ),", "    ),"]
        at += known.of_state + most * known.of_transition
    parts = [render("python_tanh.txt", {}), f"def _activation(a, cell):\n{_ACTIVATIONS['sigmoid']}\n"]
    parts.append(render("python_modules.txt", {}))
    own_numbers = {"behaviour": str(len(modules.BEHAVIOURS)), "condition": str(len(modules.CONDITIONS))}
    forget = ["self._turn = 0", *(["self._modules.forget()"] if own else [])]
    step = [
        "state, transitions = _STATES[self._state]",
        "words = _words(values[8])",
        "actuators = self._act(state, values, words, cell)",
        "if not self._settled:",
        "    self._settled = True",
        "    return actuators",
        "holding = []",
        "for number, (transition, word) in enumerate(zip(transitions, words)):"
        if own
        else "for transition, word in zip(transitions, words):",
        f"    if (word >> 8) / 16777216.0 < {_probability(own, 'number', 'number')}:",
        "        holding.append(transition)",
        "if holding:",
        "    self._state = int(holding[_below(words[2], words[3], len(holding))][0])",
        "    self._settled = False",
        *(f"    {line}" for line in forget),
        "return actuators",
    ]
    within = [
        "if not 0.0 <= values[8] <= 1.0:",
        '    raise ValueError("sensor %s is %s, expected 0 to 1" % (SENSORS[8], values[8]))',
    ]
    checks = subject.checks_random
    reset = ["self._state = 0", "self._settled = False", *forget]
    kept = "the state, whether it was entered before, and how long the robot still turns are kept"
    if tree:
        step = [
            "words = _words(values[8])",
            "while self._state < len(_STATES):",
            "    state, (transition,) = _STATES[self._state]",
            "    drawn = (words[self._state] >> 8) / 16777216.0",
            f"    if not drawn < {_probability(own, '0', 'self._state')}:",
            "        return self._act(state, values, words, cell)",
            "    self._state += 1",
            *(f"    {line}" for line in forget),
            "self._state = 0",
            *forget,
            "return [0.0, 0.0]",
        ]
        reset, kept = [reset[0], *forget], "the subtree and how long the robot still turns are kept"
    act = {"own": render("python_own_act.txt", own_numbers).rstrip("\n") if own else ""}
    methods = [render("python_modules_act.txt", act).rstrip("\n")]
    if own:
        methods.append(render("python_own_probability.txt", own_numbers).rstrip("\n"))
    return PythonCode(
        "\n".join([*lines, ")"]),
        "\n\n".join(parts).rstrip("\n"),
        _indented(["self._modules = Modules()"]) if own else "",
        _indented(reset),
        _indented([*(within if checks else []), *step]) + "\n\n" + "\n\n".join(methods),
        kept,
        "from math import sqrt",
        "So it does for a sensor random that is not from 0 to 1." if checks else "",
    )


def _probability(own: bool, number: str, place: str) -> str:
    return (
        f"self._probability(transition, values, cell, {number}, {place})"
        if own
        else "_probability(transition, values, cell)"
    )


_KINDS: dict[str, Callable[[Subject, Numbers], PythonCode]] = {
    "evostick": _evostick,
    "fully_meshed": _fully_meshed,
    "hebbian": _hebbian,
    "layered": _layered,
    "mealy_fsm": _mealy_fsm,
    "neat": _neat,
    modules.KIND: _modules,
    modules.PYTHON_KIND: _modules,
}
