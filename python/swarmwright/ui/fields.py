"""The form of an experiment: its sections and fields, from the schema and the descriptions of simulations.

The schema of all kinds is large. A form has the fields of the kinds that an experiment has, with references
and alternatives resolved to what a person can enter.
"""

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from swarmwright import InputError, templates
from swarmwright.common.options import Options
from swarmwright.common.simulation_names import is_python
from swarmwright.common.yaml import dump_flow
from swarmwright.experiment.budget import LIMITS
from swarmwright.experiment.document import DEFAULT_KINDS, Document
from swarmwright.experiment.launchers import LAUNCHERS
from swarmwright.experiment.schema import options_schema
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.simulations import catalogue
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.command.ros_definition import RosOptions

MAPPINGS: Mapping[str, type[Options]] = {"command": CommandOptions, "fmu": FmuOptions, "ros": RosOptions}
"""Simulations that are written as a mapping, by the key that they need."""
BUDGET = (*LIMITS, "target")
"""Options of methods that are in a section of their own."""
LONGEST_NAME = 1000
"""Characters of the name of a kind or simulation."""
PLACES = ("auto", "local", "in-process", "1", "2", "4", "8")
"""Suggestions for `servers`."""
TYPES = {"integer": "integer", "number": "number", "boolean": "boolean", "string": "text", "array": "list"}
WORDS = {"integer": "whole number", "boolean": "true or false", "any": "YAML"}
PARAMETER_TYPES = {"integer": ("integer",), "number": ("number",), "string": ("text",)}
"""Of the types in descriptions of simulations, those that are not entered as YAML."""
_LOCK = threading.Lock()
"""Models get their descriptions when they are first used, in one thread at a time."""


@dataclass(frozen=True)
class Field:
    """A value of the experiment that can be entered.

    Attributes:
        path: keys from the top.
        takes: what it may be: integer, number, boolean, text, list, mapping, any.
        choices: values that a select offers; suggestions where it takes more.
        low: smallest number.
        high: largest number.
        range: both in words, empty for none.
        default: as YAML, empty for none.
        help: what it means, with its unit.
        is_required: whether the experiment needs it.
        is_kind: whether other fields depend on it.
    """

    path: tuple[str, ...]
    takes: tuple[str, ...]
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    range: str = ""
    default: str = ""
    help: str = ""
    is_required: bool = False
    is_kind: bool = False

    @property
    def is_choice(self) -> bool:
        """Whether the field accepts only its choices."""
        return not self.takes

    def describe(self) -> dict[str, Any]:
        """Return it for the browser, without what is empty."""
        words = " or ".join(WORDS.get(kind, kind) for kind in self.takes)
        values = {**vars(self), "kind": f"{words} {self.range}".strip()}
        return {
            key: value
            for key, value in values.items()
            if value is not None and value is not False and value not in ("", ()) and key != "range"
        }


@dataclass(frozen=True)
class Section:
    """A part of the form."""

    title: str
    fields: tuple[Field, ...]
    help: str = ""

    def describe(self) -> dict[str, Any]:
        """Return it for the browser."""
        return {"title": self.title, "help": self.help, "fields": [entry.describe() for entry in self.fields]}


@dataclass(frozen=True)
class Kinds:
    """What the fields of an experiment depend on."""

    simulation: str = ""
    """Its name; for a mapping, its key: command, fmu or ros."""
    is_mapping: bool = False
    controller: str = DEFAULT_KINDS["controller"]
    method: str = DEFAULT_KINDS["method"]
    ranking: str = DEFAULT_KINDS["ranking"]
    launcher: str = ""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Kinds":
        """Return the kinds in the values of an experiment, which may have mistakes."""
        simulation, servers = values.get("simulation"), values.get("servers")
        if isinstance(simulation, str) and len(simulation) > LONGEST_NAME:
            simulation = ""
        key = next((key for key in MAPPINGS if isinstance(simulation, Mapping) and key in simulation), "")
        kinds = {}
        for section, default in DEFAULT_KINDS.items():
            entry = values.get(section)
            kind = entry.get("kind", default) if isinstance(entry, Mapping) else entry or default
            kinds[section] = kind if isinstance(kind, str) and len(kind) <= LONGEST_NAME else ""
        launcher = servers.get("launcher") if isinstance(servers, Mapping) else ""
        return cls(
            simulation=simulation if isinstance(simulation, str) else key,
            is_mapping=bool(key),
            launcher=launcher if isinstance(launcher, str) and len(launcher) <= LONGEST_NAME else "",
            **kinds,
        )


Parameters = tuple[Field, ...]


@dataclass(frozen=True)
class Form:
    """The fields of an experiment of certain kinds."""

    sections: tuple[Section, ...]
    by_path: Mapping[tuple[str, ...], Field] = field(default_factory=dict)

    def field(self, path: Sequence[str]) -> Field:
        """Return the field of a path; one that takes any value where the form has none."""
        return self.by_path.get(tuple(path)) or Field(tuple(path), ("any",))

    def order(self, path: Sequence[str]) -> list[str]:
        """Return the keys beside a path in their usual order."""
        above = tuple(path[:-1])
        return [entry[-1] for entry in self.by_path if entry[:-1] == above]


def describe_form(kinds: Kinds, parameters: Parameters | None = None) -> Form:
    """Return the form of an experiment.

    Args:
        kinds: of the experiment.
        parameters: of its simulation, where that is a class whose description was read elsewhere.
    """
    with _LOCK:
        form = _describe(kinds)
    if not parameters:
        return form
    first, *rest = form.sections
    fields = tuple(entry for entry in first.fields if entry.path[0] != "parameters")
    return _with_paths((replace(first, fields=(fields[0], *parameters, *fields[1:])), *rest))


@lru_cache(maxsize=64)
def _describe(kinds: Kinds) -> Form:
    schema = options_schema(Document)
    fields = {entry.path: entry for entry in _iter_fields(schema, ())}
    top = {path[0]: [entry for entry in fields.values() if entry.path[0] == path[0]] for path in fields}
    method = _kind_fields("method", kinds.method)
    budget = [entry for entry in method if entry.path[-1] in BUDGET]
    rest = [entry for key in ("fitness", "sensors", "actuators", "requirements") for entry in top[key]]
    whether = Field(("validate",), ("boolean",), default="true", help=_help(schema, "validate"))
    sections = (
        ("Simulation", [*_simulation(kinds, top["simulation"][0]), *rest]),
        ("Controller", [*_kind_fields("controller", kinds.controller), *top["start_from"]]),
        ("Method", [*(entry for entry in method if entry not in budget), *top["seed"]]),
        ("Budget", budget),
        ("Ranking", _kind_fields("ranking", kinds.ranking)),
        ("Validation", [whether, *top["validate"]]),
        ("Servers", [*_servers(kinds, top["servers"][0]), *top["broker"], *top["prefix"], *top["mode"]]),
        ("Time limits", top["timeouts"]),
        ("Failures", top["faults"]),
    )  # fmt: skip
    return _with_paths(tuple(Section(title, tuple(entries)) for title, entries in sections))


def _help(schema: Mapping[str, Any], key: str) -> str:
    """Return the description of a key of a schema."""
    return str(schema["properties"][key].get("description", ""))


def _with_paths(sections: tuple[Section, ...]) -> Form:
    keys = ("simulation", "requirements", "parameters", *Document.model_fields)
    fields = [entry for section in sections for entry in section.fields]
    tops = {
        path: Field((path,), ("any",))
        for path in ("validate" if key == "validation" else key for key in keys)
    }
    return Form(
        sections,
        {**{entry.path: entry for entry in tops.values()}, **{entry.path: entry for entry in fields}},
    )


def _kind_fields(section: str, kind: str) -> list[Field]:
    """Return the kind of a section, and its options; no options for a class in a file, or an unknown kind."""
    registry, default = REGISTRIES[section], DEFAULT_KINDS[section]
    text = Document.model_fields[section].description or ""
    options: list[Field] = []
    if kind in registry.names():
        try:
            schema = options_schema(registry.get(kind).options_model)
        except InputError as error:  # its package cannot be imported
            text = str(error)
        else:
            text = schema.get("description", text)
            options = [entry for entry in _iter_fields(schema, (section,)) if entry.path[-1] != "kind"]
    return [
        Field((section, "kind"), (), tuple(registry.names()), default=default, help=text, is_kind=True),
        *options,
    ]


def _simulation(kinds: Kinds, name: Field) -> list[Field]:
    """Return the simulation, and its parameters, or the keys of its mapping."""
    if kinds.is_mapping:
        schema = options_schema(MAPPINGS[kinds.simulation])
        return [*_iter_fields(schema, ("simulation",)), *_parameter_fields({})]
    described: Mapping[str, Any] = {}
    if catalogue.find_built_in(kinds.simulation) is not None:
        described = catalogue.description(catalogue.find_built_in(kinds.simulation) or "")["parameters"]
    choices = (*catalogue.titles(), *templates.simulators())
    return [replace(name, takes=("text",), choices=choices, is_kind=True), *_parameter_fields(described)]


def parameter_fields(described: Mapping[str, Mapping[str, Any]]) -> Parameters:
    """Return the fields of a simulation's parameters, described as by `catalogue.description`."""
    return tuple(_parameter_fields(described))


def _parameter_fields(described: Mapping[str, Mapping[str, Any]]) -> Iterator[Field]:
    seed = {"seed": {"type": "integer", "default": 0, "description": "Seed of the first episode, 0 to 2^62."}}
    described = {**{name: entry for name, entry in described.items() if name != "seed"}, **seed}
    for name, parameter in described.items():
        default = parameter.get("default")
        takes = PARAMETER_TYPES.get(str(parameter.get("type")), ("any",))
        if parameter.get("type") == "boolean":
            takes = ("boolean",)
        choices = tuple(templates.missions()) if name == "mission" and "mission" in described else ()
        yield Field(
            ("parameters", name),
            takes,
            choices,
            default="" if default is None else dump_flow(default),
            help=str(parameter.get("description", "")),
        )


def is_described_elsewhere(kinds: Kinds) -> bool:
    """Return whether only the code of the simulation, which is not executed here, knows its parameters."""
    return (
        not kinds.is_mapping
        and catalogue.find_built_in(kinds.simulation) is None
        and is_python(kinds.simulation)
    )


def _servers(kinds: Kinds, servers: Field) -> list[Field]:
    """Return where evaluations run: a word or number, or a launcher with its options."""
    names = tuple(LAUNCHERS.names())
    launcher = Field(
        ("servers", "launcher"), (), names, help="Starts servers on other machines.", is_kind=True
    )
    if kinds.launcher not in names:
        return [replace(servers, takes=("integer", "text"), choices=PLACES), launcher]
    schema = options_schema(LAUNCHERS.get(kinds.launcher).options_model)
    fields = [entry for entry in _iter_fields(schema, ("servers",)) if entry.path[-1] != "launcher"]
    return [replace(launcher, help=schema.get("description", launcher.help)), *fields]


def _iter_fields(schema: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[Field]:
    """Yield the fields of a section, with those of mappings in it that have keys of their own."""
    definitions = schema.get("$defs", {})
    for key, entry in schema["properties"].items():
        resolved = _resolve(entry, definitions)
        mappings = [option for option in resolved if "properties" in option]
        if (
            len(mappings) == 1
            and len(path) < 2
            and all(_takes(option) in {"mapping", "boolean"} for option in resolved)
        ):
            nested = {
                "properties": mappings[0]["properties"],
                "required": mappings[0].get("required", []),
                "$defs": definitions,
            }
            yield from _iter_fields(nested, (*path, key))
            continue
        yield _make_field((*path, key), entry, resolved, is_required=key in schema.get("required", []))


def _make_field(
    path: tuple[str, ...],
    entry: Mapping[str, Any],
    options: Sequence[Mapping[str, Any]],
    *,
    is_required: bool,
) -> Field:
    choices = [
        value
        for option in options
        for value in option.get("enum", [option["const"]] if "const" in option else [])
    ]
    takes = list(dict.fromkeys(kind for option in options for kind in [_takes(option)] if kind))
    takes += ["number"] * any(isinstance(choice, int | float) for choice in choices)
    numbers = [option for option in options if _takes(option) in {"integer", "number"}]
    low, high = (
        _limit(numbers, *names)
        for names in (("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum"))
    )
    default = entry.get("default")
    return Field(
        path,
        tuple(takes),
        tuple(str(choice) for choice in choices),
        low,
        high,
        _range_in_words(numbers[0]) if len(numbers) == 1 else "",
        "" if default is None or default in ({}, []) else dump_flow(default),
        str(entry.get("description", "")),
        is_required,
    )


def _resolve(entry: Mapping[str, Any], definitions: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the alternatives of a value, without null."""
    if "$ref" in entry:
        return _resolve(definitions[entry["$ref"].rpartition("/")[2]], definitions)
    for key in ("anyOf", "oneOf"):
        if key in entry:
            return [option for inner in entry[key] for option in _resolve(inner, definitions)]
    return [] if entry.get("type") == "null" else [entry]


def _takes(option: Mapping[str, Any]) -> str:
    """Return what an alternative takes, empty for one of its values."""
    if "enum" in option or "const" in option:
        return ""
    kind = option.get("type")
    return TYPES.get(kind, "mapping" if kind == "object" else "any") if isinstance(kind, str) else "any"


def _limit(numbers: Sequence[Mapping[str, Any]], *names: str) -> float | None:
    limits = [option[name] for option in numbers for name in names if name in option]
    return limits[0] if len(limits) == 1 else None


def _range_in_words(option: Mapping[str, Any]) -> str:
    low, high = option.get("minimum"), option.get("maximum")
    if low is not None and high is not None:
        return f"{_number(low)} to {_number(high)}"
    words = (
        ("minimum", "at least"),
        ("exclusiveMinimum", "above"),
        ("maximum", "at most"),
        ("exclusiveMaximum", "below"),
    )
    return ", ".join(f"{word} {_number(option[name])}" for name, word in words if name in option)


def _number(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:,.12g}"
