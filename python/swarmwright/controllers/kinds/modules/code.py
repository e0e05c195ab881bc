"""Source code of machines and trees of modules.

Behaviours and conditions in Python are exported to C if their class has `c_code`.
"""

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import dedent, indent

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.tracebacks import locate_definition
from swarmwright.controllers.kinds.modules.tables import catalogue_of, machine_weights, select_user_modules
from swarmwright.controllers.modules import Behaviour, Condition, grammar, machine_texts
from swarmwright.controllers.modules.registered import implementation
from swarmwright.controllers.source import Evolved, in_c, in_python
from swarmwright.controllers.source.text import is_reserved, literals, plain, templates, wrap_items

_SENSES = {
    "proximity_x": 0,
    "proximity_y": 1,
    "light_x": 2,
    "light_y": 3,
    "ground": 4,
    "neighbours": 5,
    "attraction_x": 6,
    "attraction_y": 7,
}
"""Names of sensors in user code, and their indices."""
_MACROS = {
    "real": "{p}_real",
    "product": "{p}_product",
    "root(x)": "{p}_root(x)",
    "length(x, y)": "{p}_length(x, y)",
    "random_unit(index)": "{p}_random_unit(random, (uint32_t)(index))",
    "random_integer(below, index)": "{p}_random_integer(random, (uint32_t)(below), (uint32_t)(index))",
}
"""Macros that user code may use, and their expansions; {p} is the prefix of names."""
_RESERVED_NAMES = {
    *_SENSES,
    *(macro.partition("(")[0] for macro in _MACROS),
    "state",
    "random",
    "row",
    "sensors",
}
_RESERVED_NAMES |= {"left", "right", "probability", "actuators"}
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class UserCode:
    """The parts of a machine's C code that come from user modules."""

    kernel: str = ""
    """Functions."""
    members: tuple[str, ...] = ()
    """Declarations in the struct."""
    calls: Mapping[str, str] = field(default_factory=dict)
    """Replacements in the template of a step: act, probability, forget."""


def generate_user_code(
    catalogue: grammar.Catalogue, language: Mapping[str, str], *, tree: bool, transitions: int
) -> UserCode:
    """Generate the C code of user modules.

    Args:
        catalogue: as `catalogue_of` returns it.
        language: replacements in templates that differ between C and C++.
        tree: whether the controller is a tree, which evaluates one condition at a time.
        transitions: most transitions of a state.

    Raises InputError for a module without code in C, and for a parameter whose name is reserved in C.
    """
    behaviours, conditions = (
        select_user_modules(module_kinds) for module_kinds in (catalogue.behaviours, catalogue.conditions)
    )
    behaviour_kinds = [implementation("behaviour", behaviour) for behaviour in behaviours]
    condition_kinds = [implementation("condition", condition) for condition in conditions]
    _check([*zip(behaviours, behaviour_kinds, strict=True), *zip(conditions, condition_kinds, strict=True)])
    p, receiver, detail = language["p"], language["self"], language["detail"]
    row = f"&row[{catalogue.state_weights}]" if tree else "transition"
    calls = {
        "act": f"{detail}{p}_act(row, &{receiver}turn, words, sensors, actuators);",
        "probability": f"{detail}{p}_probability({row}, sensors)",
        "forget": "",
    }
    functions, members, forget = [], [], []
    bodies = " ".join(
        [
            *(module.c_code or "" for module in behaviour_kinds),
            *(module.c_code or "" for module in condition_kinds),
        ]
    )
    if behaviour_kinds or condition_kinds:
        functions.append(render("c_own_random.txt", language))
        functions += [
            render(f"c_own_{word}.txt", language)
            for word in ("random_unit", "random_integer")
            if word in _WORD.findall(bodies)
        ]
    if behaviour_kinds:
        most = max(1, *(module.state for module in behaviour_kinds))
        members.append(f"    float kept[{most}];")
        forget.append(f"    {detail}{p}_forget({receiver}kept, {most});")
        functions += [
            _behaviour(number, behaviour, kind, catalogue, language)
            for number, (behaviour, kind) in enumerate(zip(behaviours, behaviour_kinds, strict=True))
        ]
        cases = _cases(
            len(behaviour_kinds),
            len(grammar.BEHAVIOURS),
            f"{p}_behaviour",
            "row, kept, random, sensors, actuators",
        )
        functions.append(render("c_own_act.txt", {**language, "cases": cases}))
        calls["act"] = (
            f"{detail}{p}_act_all(row, &{receiver}turn, {receiver}kept, words, sensors, actuators);"
        )
    if condition_kinds:
        most = max(1, *(module.state for module in condition_kinds))
        count = 1 if tree else transitions
        members.append(f"    float kept_by_conditions[{count * most}];")
        forget.append(f"    {detail}{p}_forget({receiver}kept_by_conditions, {count * most});")
        functions += [
            _condition(number, condition, kind, catalogue, language)
            for number, (condition, kind) in enumerate(zip(conditions, condition_kinds, strict=True))
        ]
        cases = _cases(
            len(condition_kinds),
            len(grammar.CONDITIONS),
            f"return {p}_condition",
            "transition, kept, random, sensors",
        )
        functions.append(render("c_own_probability.txt", {**language, "cases": cases}))
        at = f"{receiver}kept_by_conditions" if tree else f"&{receiver}kept_by_conditions[{most} * k]"
        position = f"(uint32_t){receiver}state" if tree else "(uint32_t)k"
        calls["probability"] = f"{detail}{p}_probability_of_all({row}, {at}, {position}, sensors)"
    if forget:
        functions.append(render("c_own_forget.txt", language))
        calls["forget"] = "\n".join(forget)
    return UserCode("\n".join(functions), tuple(members), calls)


def _cases(count: int, first: int, function: str, arguments: str) -> str:
    lines = []
    for number in range(count):
        lines += [f"    case {first + number}:", f"        {function}_{number}({arguments});"]
        if not function.startswith("return"):
            lines.append("        break;")
    return "\n".join(lines)


def _check(parts: list[tuple[grammar.Module, type[Behaviour] | type[Condition]]]) -> None:
    """Raise InputError for modules without code in C."""
    missing = [
        f"{module.name} ({locate_definition(class_)})" for module, class_ in parts if class_.c_code is None
    ]
    if missing:
        verb = "has" if len(missing) == 1 else "have"
        raise InputError(
            f"controller: {', '.join(missing)} {verb} no C code; set the attribute c_code of the class, see "
            "docs/how-to/plug-ins.md, or use --to python, which copies the Python code, or --to machine, "
            "which writes the names of the modules"
        )
    for module, class_ in parts:
        if not isinstance(class_.c_code, str):
            raise InputError(
                f"{locate_definition(class_)}: {module.name}: c_code must be a string of C statements, not "
                f"{class_.c_code!r}"
            )
        for name in module.parameters:
            if is_reserved(name) or name in _RESERVED_NAMES or not _WORD.fullmatch(name):
                raise InputError(
                    f"{locate_definition(class_)}: {module.name}: parameter {name!r}: is a reserved name in "
                    "C; rename it"
                )


def _behaviour(
    number: int,
    module: grammar.Module,
    kind: type[Behaviour],
    catalogue: grammar.Catalogue,
    language: Mapping[str, str],
) -> str:
    columns = catalogue.behaviour_columns[module.name]
    return _function("c_own_behaviour.txt", number, module, kind, columns, language)


def _condition(
    number: int,
    module: grammar.Module,
    kind: type[Condition],
    catalogue: grammar.Catalogue,
    language: Mapping[str, str],
) -> str:
    columns = catalogue.condition_columns[module.name]
    return _function("c_own_condition.txt", number, module, kind, columns, language)


def _function(
    template: str,
    number: int,
    module: grammar.Module,
    kind: type[Behaviour] | type[Condition],
    columns: Mapping[str, int],
    language: Mapping[str, str],
) -> str:
    """Return the C function of a module: declarations that its code needs, and the code."""
    body = dedent(inspect.cleandoc(kind.c_code or "")).strip()
    words = set(_WORD.findall(body))
    lines = [f"const float {name} = sensors[{column}];" for name, column in _SENSES.items() if name in words]
    lines += [
        f"const float {name} = {language['PREFIX']}_READ(&row[{column}]);"
        for name, column in columns.items()
        if name in words
    ]
    used = {
        "state": "state" in words,
        "random": bool(words & {"random_unit", "random_integer"}),
        "row": bool(words & set(columns)),
        "sensors": bool(words & set(_SENSES)),
    }
    ignored = [f"(void){name};" for name, is_used in used.items() if not is_used]
    macros = {
        name: text.format(p=language["p"])
        for name, text in _MACROS.items()
        if name.partition("(")[0] in words
    }
    return render(
        template,
        {
            **language,
            "number": str(number),
            "name": plain(f"{module.name}, {module.file}" if module.file else module.name),
            "locals": indent("\n".join([*lines, *ignored]), "    "),
            "defined": "\n".join(f"#define {name} {text}" for name, text in macros.items()),
            "body": indent(body, "    "),
            "undefined": "\n".join(f"#undef {name.partition('(')[0]}" for name in macros),
        },
    )


render = templates(__file__)

_OUTSIDE = "So it does when the sensor random is not from 0 to 1."


def c(controller: Evolved, language: dict[str, str]) -> in_c.Code:
    """Return the code in C or C++."""
    states, most = grammar.states_of(controller.specification), int(controller.specification["transitions"])
    tree = grammar.is_tree(controller.specification)
    weights = machine_weights(controller)
    texts = literals(weights)
    name = "subtree" if tree else "state"
    catalogue = catalogue_of(controller.specification)
    user_code = generate_user_code(catalogue, language, tree=tree, transitions=most)
    first, each = catalogue.state_weights, catalogue.transition_weights
    width = first + most * each
    of_states, of_transitions = (
        "".join(
            f", {module.name} {name}" for module in many if not module.built_in for name in module.parameters
        )
        for many in (catalogue.behaviours, catalogue.conditions)
    )
    lines = [f"    /* number of {name}s */", wrap_items(texts[:1])]
    for index in range(int(controller.specification["states"])):
        row = texts[1 + index * width :][:width]
        words = machine_texts.words_of(states[index]) if index < len(states) else "not used"
        lines.append(f"    /* {name} {index}, {words}: behaviour, rwm, alpha, transitions{of_states} */")
        lines.append(wrap_items(row[:first]))
        for k in range(most):
            start_column = first + k * each
            used = index < len(states) and k < len(states[index].transitions)
            words = machine_texts.words_of(states[index].transitions[k]) if used else "not used"
            if used and tree:
                words = f"next subtree if {machine_texts.condition_words(states[index])}"
            lines.append(f"    /* {words}: target, condition, probability, xi, eta{of_transitions} */")
            lines.append(wrap_items(row[start_column : start_column + each]))
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
            "refused": in_c.refusal_condition(language, len(states), outside),
            **user_code.calls,
            "forget_within": indent(user_code.calls["forget"], "    "),
            **({"count": str(len(states))} if tree else {"transitions": str(most)}),
        },
    )
    state_members = ("    uint8_t state;", "    uint8_t settled;", "    int8_t turn;")
    kernel = render("c_modules.txt", {**language, "activation": activation.rstrip()})
    words = (
        "the number of the subtree, and how long the robot still turns"
        if tree
        else "the number of the state, whether it was entered before, and how long the robot still turns"
    )
    return in_c.Code(
        (in_c.Table("weights", "float", len(texts), "\n".join(lines), weights),),
        f"{kernel}\n{user_code.kernel}" if user_code.kernel else kernel,
        step,
        "\n".join([*((state_members[0], state_members[2]) if tree else state_members), *user_code.members]),
        f"{words}; what its modules remember" if user_code.members else words,
        _OUTSIDE if outside else "",
    )


def python(controller: Evolved, numbers: in_python.Numbers) -> in_python.PythonCode:
    """Return the code in Python."""
    weights, most = machine_weights(controller), int(controller.specification["transitions"])
    catalogue, has_user_modules = (
        catalogue_of(controller.specification),
        controller.kind == grammar.PYTHON_KIND,
    )
    states, tree = grammar.states_of(controller.specification), grammar.is_tree(controller.specification)
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
        row = weights[at : at + (catalogue.state_weights if has_user_modules else 3)]
        lines += ["    (", indent(f"{numbers(row)},", " " * 8), "        ("]
        for k, transition in enumerate(state.transitions):
            start_column = at + catalogue.state_weights + k * catalogue.transition_weights
            words = (
                f"next subtree if {machine_texts.condition_words(state)}"
                if tree
                else machine_texts.words_of(transition)
            )
            lines.append(f"            # {words}")
            lines.append(
                indent(
                    f"{numbers(weights[start_column : start_column + catalogue.transition_weights])},",
                    " " * 12,
                )
            )
        lines += ["        ),", "    ),"]
        at += catalogue.state_weights + most * catalogue.transition_weights
    parts = [
        in_python.render("python_tanh.txt", {}),
        f"def _activation(a, cell):\n{in_python.ACTIVATIONS['sigmoid']}\n",
    ]
    parts.append(render("python_modules.txt", {}))
    own_numbers = {"behaviour": str(len(grammar.BEHAVIOURS)), "condition": str(len(grammar.CONDITIONS))}
    forget = ["self._turn = 0", *(["self._modules.forget()"] if has_user_modules else [])]
    step = [
        "state, transitions = _STATES[self._state]",
        "words = _words(values[8])",
        "actuators = self._act(state, values, words, cell)",
        "if not self._settled:",
        "    self._settled = True",
        "    return actuators",
        "holding = []",
        "for number, (transition, word) in enumerate(zip(transitions, words)):"
        if has_user_modules
        else "for transition, word in zip(transitions, words):",
        f"    if (word >> 8) / 16777216.0 < {_probability(has_user_modules, 'number', 'number')}:",
        "        holding.append(transition)",
        "if holding:",
        "    self._state = int(holding[_below(words[2], words[3], len(holding))][0])",
        "    self._settled = False",
        *(f"    {line}" for line in forget),
        "return actuators",
    ]
    range_check = [
        "if not 0.0 <= values[8] <= 1.0:",
        '    raise ValueError("sensor %s is %s, expected 0 to 1" % (SENSORS[8], values[8]))',
    ]
    checks = controller.checks_random
    reset = ["self._state = 0", "self._settled = False", *forget]
    state_words = "the state, whether it was entered before, and how long the robot still turns are kept"
    if tree:
        step = [
            "words = _words(values[8])",
            "while self._state < len(_STATES):",
            "    state, (transition,) = _STATES[self._state]",
            "    drawn = (words[self._state] >> 8) / 16777216.0",
            f"    if not drawn < {_probability(has_user_modules, '0', 'self._state')}:",
            "        return self._act(state, values, words, cell)",
            "    self._state += 1",
            *(f"    {line}" for line in forget),
            "self._state = 0",
            *forget,
            "return [0.0, 0.0]",
        ]
        reset, state_words = [reset[0], *forget], "the subtree and how long the robot still turns are kept"
    act = {"own": render("python_own_act.txt", own_numbers).rstrip("\n") if has_user_modules else ""}
    methods = [render("python_modules_act.txt", act).rstrip("\n")]
    if has_user_modules:
        methods.append(render("python_own_probability.txt", own_numbers).rstrip("\n"))
    return in_python.PythonCode(
        "\n".join([*lines, ")"]),
        "\n\n".join(parts).rstrip("\n"),
        in_python.indent_method(["self._modules = Modules()"]) if has_user_modules else "",
        in_python.indent_method(reset),
        in_python.indent_method([*(range_check if checks else []), *step]) + "\n\n" + "\n\n".join(methods),
        state_words,
        "from math import sqrt",
        "So it does for a sensor random that is not from 0 to 1." if checks else "",
    )


def _probability(has_user_modules: bool, number: str, position: str) -> str:
    return (
        f"self._probability(transition, values, cell, {number}, {position})"
        if has_user_modules
        else "_probability(transition, values, cell)"
    )
