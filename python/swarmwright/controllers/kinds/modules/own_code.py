"""Behaviours and conditions in Python whose authors have given the same in C."""

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import dedent, indent

from swarmwright.common import modules
from swarmwright.common.errors import InputError
from swarmwright.common.tracebacks import place_of
from swarmwright.controllers.kinds.modules.tables import own_modules
from swarmwright.controllers.modules import Behaviour, Condition
from swarmwright.controllers.modules.registered import implementation
from swarmwright.controllers.source.text import is_reserved, plain, templates

render = templates(__file__)

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
"""Names in the code of authors, and the sensors that they are."""
_MACROS = {
    "real": "{p}_real",
    "product": "{p}_product",
    "root(x)": "{p}_root(x)",
    "length(x, y)": "{p}_length(x, y)",
    "random_unit(index)": "{p}_random_unit(random, (uint32_t)(index))",
    "random_integer(below, index)": "{p}_random_integer(random, (uint32_t)(below), (uint32_t)(index))",
}
"""What the code of authors may use, and what that is; {p} is the prefix of names."""
_TAKEN = {*_SENSES, *(one.partition("(")[0] for one in _MACROS), "state", "random", "row", "sensors"}
_TAKEN |= {"left", "right", "probability", "actuators"}
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class OwnCode:
    """What machines with modules of authors have in C beside, or in the place of, what all have."""

    kernel: str = ""
    """Functions."""
    members: tuple[str, ...] = ()
    """Of the struct."""
    calls: Mapping[str, str] = field(default_factory=dict)
    """Replacements in the template of a step: act, probability, forget."""


def own_code(
    catalogue: modules.Catalogue, language: Mapping[str, str], *, tree: bool, transitions: int
) -> OwnCode:
    """Return the code of what is not the engine's.

    Args:
        catalogue: as `catalogue_of` returns it.
        language: replacements in templates that differ between C and C++.
        tree: whether it is of a tree, which evaluates one condition at a time.
        transitions: of a state, at most.

    Raises InputError for a module without code in C, and for a parameter that has no name there.
    """
    behaviours, conditions = (own_modules(one) for one in (catalogue.behaviours, catalogue.conditions))
    kinds = [implementation("behaviour", one) for one in behaviours]
    others = [implementation("condition", one) for one in conditions]
    _check([*zip(behaviours, kinds, strict=True), *zip(conditions, others, strict=True)])
    p, own, detail = language["p"], language["self"], language["detail"]
    row = f"&row[{catalogue.of_state}]" if tree else "transition"
    calls = {
        "act": f"{detail}{p}_act(row, &{own}turn, words, sensors, actuators);",
        "probability": f"{detail}{p}_probability({row}, sensors)",
        "forget": "",
    }
    functions, members, forget = [], [], []
    bodies = " ".join([*(one.c_code or "" for one in kinds), *(one.c_code or "" for one in others)])
    if kinds or others:
        functions.append(render("c_own_random.txt", language))
        functions += [
            render(f"c_own_{word}.txt", language)
            for word in ("random_unit", "random_integer")
            if word in _WORD.findall(bodies)
        ]
    if kinds:
        most = max(1, *(one.state for one in kinds))
        members.append(f"    float kept[{most}];")
        forget.append(f"    {detail}{p}_forget({own}kept, {most});")
        functions += [
            _behaviour(number, one, kind, catalogue, language)
            for number, (one, kind) in enumerate(zip(behaviours, kinds, strict=True))
        ]
        cases = _cases(
            len(kinds), len(modules.BEHAVIOURS), f"{p}_behaviour", "row, kept, random, sensors, actuators"
        )
        functions.append(render("c_own_act.txt", {**language, "cases": cases}))
        calls["act"] = f"{detail}{p}_act_all(row, &{own}turn, {own}kept, words, sensors, actuators);"
    if others:
        most = max(1, *(one.state for one in others))
        count = 1 if tree else transitions
        members.append(f"    float kept_by_conditions[{count * most}];")
        forget.append(f"    {detail}{p}_forget({own}kept_by_conditions, {count * most});")
        functions += [
            _condition(number, one, kind, catalogue, language)
            for number, (one, kind) in enumerate(zip(conditions, others, strict=True))
        ]
        cases = _cases(
            len(others), len(modules.CONDITIONS), f"return {p}_condition", "transition, kept, random, sensors"
        )
        functions.append(render("c_own_probability.txt", {**language, "cases": cases}))
        at = f"{own}kept_by_conditions" if tree else f"&{own}kept_by_conditions[{most} * k]"
        place = f"(uint32_t){own}state" if tree else "(uint32_t)k"
        calls["probability"] = f"{detail}{p}_probability_of_all({row}, {at}, {place}, sensors)"
    if forget:
        functions.append(render("c_own_forget.txt", language))
        calls["forget"] = "\n".join(forget)
    return OwnCode("\n".join(functions), tuple(members), calls)


def _cases(count: int, first: int, function: str, arguments: str) -> str:
    lines = []
    for number in range(count):
        lines += [f"    case {first + number}:", f"        {function}_{number}({arguments});"]
        if not function.startswith("return"):
            lines.append("        break;")
    return "\n".join(lines)


def _check(parts: list[tuple[modules.Module, type[Behaviour] | type[Condition]]]) -> None:
    """Raise InputError for modules of which there is no code in C."""
    missing = [f"{one.name} ({place_of(kind)})" for one, kind in parts if kind.c_code is None]
    if missing:
        verb = "has" if len(missing) == 1 else "have"
        raise InputError(
            f"controller: {', '.join(missing)} {verb} no code in C; write it as the attribute c_code of the "
            "class, see docs/how-to/own-module.md; --to python copies the code in Python, --to machine "
            "writes the machine with the names of its modules"
        )
    for one, kind in parts:
        if not isinstance(kind.c_code, str):
            raise InputError(
                f"{place_of(kind)}: {one.name}: c_code must be text, statements in C, not {kind.c_code!r}"
            )
        for name in one.parameters:
            if is_reserved(name) or name in _TAKEN or not _WORD.fullmatch(name):
                raise InputError(
                    f"{place_of(kind)}: {one.name}: parameter {name!r}: has another meaning in C; rename it"
                )


def _behaviour(
    number: int,
    known: modules.Module,
    kind: type[Behaviour],
    catalogue: modules.Catalogue,
    language: Mapping[str, str],
) -> str:
    places = catalogue.behaviour_places[known.name]
    return _function("c_own_behaviour.txt", number, known, kind, places, language)


def _condition(
    number: int,
    known: modules.Module,
    kind: type[Condition],
    catalogue: modules.Catalogue,
    language: Mapping[str, str],
) -> str:
    places = catalogue.condition_places[known.name]
    return _function("c_own_condition.txt", number, known, kind, places, language)


def _function(
    template: str,
    number: int,
    known: modules.Module,
    kind: type[Behaviour] | type[Condition],
    places: Mapping[str, int],
    language: Mapping[str, str],
) -> str:
    """Return the function of a module: what its code uses, and that."""
    body = dedent(inspect.cleandoc(kind.c_code or "")).strip()
    words = set(_WORD.findall(body))
    lines = [f"const float {name} = sensors[{place}];" for name, place in _SENSES.items() if name in words]
    lines += [
        f"const float {name} = {language['PREFIX']}_READ(&row[{place}]);"
        for name, place in places.items()
        if name in words
    ]
    used = {
        "state": "state" in words,
        "random": bool(words & {"random_unit", "random_integer"}),
        "row": bool(words & set(places)),
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
            "name": plain(f"{known.name}, {known.file}" if known.file else known.name),
            "locals": indent("\n".join([*lines, *ignored]), "    "),
            "defined": "\n".join(f"#define {name} {text}" for name, text in macros.items()),
            "body": indent(body, "    "),
            "undefined": "\n".join(f"#undef {name.partition('(')[0]}" for name in macros),
        },
    )
