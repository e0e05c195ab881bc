"""Source code of machines and trees of modules."""

from textwrap import indent

import numpy as np

from swarmwright.common import machine_texts, modules
from swarmwright.controllers.kinds.modules.own_code import own_code
from swarmwright.controllers.kinds.modules.tables import catalogue_of, machine_weights
from swarmwright.controllers.source import Evolved, in_c, in_python
from swarmwright.controllers.source.text import literals, templates, wrapped

render = templates(__file__)

_OUTSIDE = "So it does when the sensor random is not from 0 to 1."


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    states, most = modules.states_of(controller.specification), int(controller.specification["transitions"])
    tree = modules.is_tree(controller.specification)
    weights = machine_weights(controller)
    texts = literals(weights)
    name = "subtree" if tree else "state"
    known = catalogue_of(controller.specification)
    own = own_code(known, language, tree=tree, transitions=most)
    first, each = known.of_state, known.of_transition
    width = first + most * each
    of_states, of_transitions = (
        "".join(f", {one.name} {name}" for one in many if not one.built_in for name in one.parameters)
        for many in (known.behaviours, known.conditions)
    )
    lines = [f"    /* number of {name}s */", wrapped(texts[:1])]
    for index in range(int(controller.specification["states"])):
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
        in_c.render(f"c_{name}.txt", {**language, "which": ""}) for name in ("tanh", "activation_sigmoid")
    )
    checks = controller.checks_random and not language.get("loaded")
    outside = "!(sensors[8] >= 0.0f && sensors[8] <= 1.0f)" if checks else ""
    step = render(
        "c_step_tree.txt" if tree else "c_step_modules.txt",
        {
            **language,
            "words": f"{len(states)} {name}s",
            "width": str(width),
            "first": str(first),
            "each": str(each),
            "refused": in_c.refused(language, len(states), outside),
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
    return in_c.Code(
        (in_c.Table("weights", "float", len(texts), "\n".join(lines), weights),),
        f"{kernel}\n{own.kernel}" if own.kernel else kernel,
        step,
        "\n".join([*((kept[0], kept[2]) if tree else kept), *own.members]),
        f"{words}; what its modules remember" if own.members else words,
        _OUTSIDE if outside else "",
    )


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    weights, most = machine_weights(controller), int(controller.specification["transitions"])
    known, own = catalogue_of(controller.specification), controller.kind == modules.PYTHON_KIND
    states, tree = modules.states_of(controller.specification), modules.is_tree(controller.specification)
    limits = np.array([0.1, 0.1, 0.95, 1 - 2**-24], np.float32)
    lines = [
        *in_python.tanh_constants(numbers),
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
    parts = [
        in_python.render("python_tanh.txt", {}),
        f"def _activation(a, cell):\n{in_python.ACTIVATIONS['sigmoid']}\n",
    ]
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
    checks = controller.checks_random
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
    return in_python.PythonCode(
        "\n".join([*lines, ")"]),
        "\n\n".join(parts).rstrip("\n"),
        in_python.indented(["self._modules = Modules()"]) if own else "",
        in_python.indented(reset),
        in_python.indented([*(within if checks else []), *step]) + "\n\n" + "\n\n".join(methods),
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
