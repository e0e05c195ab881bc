"""The reference page of experiment files: `python -m swarmwright.experiment.reference`.

A long description that an earlier section has already is replaced by a link to that section.
"""

import json
import re
import sys
from collections.abc import Iterator
from typing import Any

from swarmwright.experiment.document import DEFAULT_KINDS
from swarmwright.experiment.launchers import LAUNCHERS, LauncherOptions
from swarmwright.experiment.schema import experiment_schema, options_schema
from swarmwright.methods import METHODS
from swarmwright.simulations import catalogue

_INTRODUCTION = """\
# Experiment files

<!-- Made by `python -m swarmwright.experiment.reference`; change the descriptions in the code, not here. -->

An experiment is a YAML 1.2 file; only `simulation` is required. Unknown or duplicate keys and values of the
wrong type are errors, reported with file and line. `swarmwright new minisim` prints a commented example,
`swarmwright schema` the JSON Schema for editors: write it to a file and begin the experiment with
`# yaml-language-server: $schema=experiment.schema.json`.
"""
_OF_ROS = {
    "Sensor": "an entry of sensors",
    "Actuator": "an entry of actuators",
    "Step": "step",
    "Reset": "reset",
    "Spawn": "spawn",
    "Area": "spawn (area)",
    "Metric": "an entry of metrics",
}
"""Titles of the sections of `simulation: {ros: ..}`, by model."""
_MORE = {"modules": "[Modules](modules.md) says what each behaviour and condition computes."}
"""Texts after the description of a kind of controller."""
_LONG = 80
"""Length in characters above which a repeated description becomes a link."""


def format_reference() -> str:
    """Return the page as Markdown, for built-in components only."""
    schema = experiment_schema(only_built_in=True)
    lines = [_INTRODUCTION, "## Keys", ""]
    lines += _iter_table(schema["properties"], set(schema["required"]), schema)
    for name in ("requirements", "validate", "timeouts", "faults"):
        definition = schema["$defs"][name.capitalize()]
        lines += ["", f"## {name}", "", definition["description"], ""]
        lines += _iter_table(definition["properties"], set(definition.get("required", [])), schema)
    lines += _iter_launchers(schema)
    lines += _iter_simulations(schema)
    for name in DEFAULT_KINDS:
        lines += ["", f"## {name}", *_iter_kinds(name, schema)]
    for title in catalogue.titles():
        lines += ["", *_iter_simulation(title)]
    return "\n".join(lines).rstrip() + "\n"


def _iter_simulations(schema: dict[str, Any]) -> Iterator[str]:
    """Yield the keys of simulations that are mappings: commands, FMUs and ROS."""
    described: dict[str, str] = {}
    for name, title, required in (
        ("Command", "command", {"command"}),
        ("Fmu", "FMU", {"fmu"}),
        ("Ros", "ROS", {"ros", "step"}),
    ):
        definition = schema["$defs"][name]
        heading = f"simulation ({title})"
        yield from ("", f"## {heading}", "", definition["description"], "")
        section = _format_link(title, heading)
        yield from _iter_table(definition["properties"], required, schema, described, section)
    described = {}
    for name, title in _OF_ROS.items():
        definition = schema["$defs"][f"Ros{name}"]
        yield from ("", f"### {title}", "", definition["description"], "")
        required = set(definition.get("required", []))
        section = _format_link(title, title)
        yield from _iter_table(definition["properties"], required, schema, described, section)


def _iter_kinds(name: str, schema: dict[str, Any]) -> Iterator[str]:
    """Yield the options of a section: common options, then those of each kind."""
    # Skip classes in files.
    variants = [
        variant_schema
        for variant_schema in schema["properties"][name]["oneOf"]
        if "const" in _kind(variant_schema)
    ]
    shared = _find_shared([variant["properties"] for variant in variants])
    if shared:
        if name == "method":
            steady = [f"`{kind}`" for kind in METHODS.built_in if METHODS.get(kind).steady_state]
            listed = f"{', '.join(steady[:-1])} and {steady[-1]}"
            yield from ("", f"Only {listed} support `operation: steady_state`.")
        yield from ("", "Options of all kinds, unless a kind's own table differs:", "")
        yield from _iter_table(shared, set(), schema)
    described: dict[str, str] = {}
    kinds_by_options: dict[str, str] = {}
    for variant in variants:
        kind = _kind(variant)["const"]
        heading = f"`{name}: {{kind: {kind}}}`{' (default)' if kind == DEFAULT_KINDS[name] else ''}"
        yield from ("", f"### {heading}", "", variant["description"])
        if name == "controller" and kind in _MORE:
            yield from ("", _MORE[kind])
        options = {
            key: schema_of_key
            for key, schema_of_key in variant["properties"].items()
            if key != "kind" and schema_of_key != shared.get(key)
        }
        same = kinds_by_options.setdefault(json.dumps(options), kind)
        if options and same != kind:
            yield from ("", f"Its options are those of `{same}`.")
        elif options:
            yield ""
            section = _format_link(f"`{kind}`", heading)
            yield from _iter_table(options, set(variant.get("required", [])), schema, described, section)


def _kind(variant: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of the option `kind`, or an empty mapping."""
    kind_schema: dict[str, Any] = variant.get("properties", {}).get("kind", {})
    return kind_schema


def _find_shared(variants: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the options of all variants, in the form of the majority."""
    first, *more = variants
    shared = {}
    for key in first:
        forms = [variant[key] for variant in variants if key in variant]
        usual = max(forms, key=forms.count)
        if more and len(forms) == len(variants) and 2 * forms.count(usual) > len(variants):
            shared[key] = usual
    return shared


def _iter_launchers(schema: dict[str, Any]) -> Iterator[str]:
    """Yield the options of launchers: common options, then those of each."""
    shared = options_schema(LauncherOptions)
    yield from ("", "## servers (launcher)", "")
    yield (
        "Launchers start servers on this or other machines, see [Use clusters](../how-to/use-clusters.md). "
        "Options of all launchers, beside `launcher`, the name:"
    )
    yield ""
    yield from _iter_table(
        {key: value for key, value in shared["properties"].items() if key != "launcher"}, set(), schema
    )
    described: dict[str, str] = {}
    for kind in sorted(LAUNCHERS.built_in):
        definition = schema["$defs"][f"Launcher{kind}"]
        options = {
            key: schema_of_key
            for key, schema_of_key in definition["properties"].items()
            if key not in shared["properties"]
        }
        heading = f"`servers: {{launcher: {kind}}}`"
        yield from ("", f"### {heading}", "", definition["description"], "")
        if options:
            section = _format_link(f"`{kind}`", heading)
            yield from _iter_table(options, set(definition["required"]), schema, described, section)


def _iter_simulation(title: str) -> Iterator[str]:
    described = catalogue.description(title)
    yield f"## parameters of {title}"
    yield ""
    yield ", ".join(f"{name}: {described[name]}" for name in ("dimensions", "sensors", "actuators")) + (
        ", with the default parameters."
    )
    yield ""
    yield "| parameter | type | default | meaning |"
    yield "|---|---|---|---|"
    for name, parameter in described["parameters"].items():
        kind, meaning = (str(parameter.get(part, "")) for part in ("type", "description"))
        yield _format_row(f"`{name}`", kind, _format_code(parameter.get("default")), meaning)
    yield ""
    yield f"## metrics of {title}"
    yield ""
    yield "| metric | unit | meaning |"
    yield "|---|---|---|"
    for name, metric in described["metrics"].items():
        yield _format_row(f"`{name}`", metric["unit"], metric["description"])


def _iter_table(
    properties: dict[str, Any],
    required: set[str],
    schema: dict[str, Any],
    described: dict[str, str] | None = None,
    section: str = "",
) -> Iterator[str]:
    """Yield a table of keys.

    `described` has the section of each description so far, by the description; `section` links to this
    section.
    """
    yield "| key | type | default | meaning |"
    yield "|---|---|---|---|"
    for name, key in properties.items():
        default = "required" if name in required else _format_code(key.get("default"))
        meaning = key.get("description", "")
        if described is not None:
            first = described.setdefault(meaning, section)
            if first != section and len(meaning) > _LONG:
                meaning = f"As for {first}."
        yield _format_row(f"`{name}`", _format_type(key, schema), default, meaning)


def _format_link(text: str, heading: str) -> str:
    """Return a link to the section with this heading."""
    anchor = re.sub(r"[^\w\s-]", "", heading).lower().replace(" ", "-")
    return f"[{text}](#{anchor})"


def _format_row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _format_code(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return "" if value is None else f"`{json.dumps(value)}`"


def _format_type(key: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in key or ("oneOf" in key and "type" not in key):
        return "mapping"
    if "const" in key:
        return _format_code(key["const"])
    if "enum" in key:
        return ", ".join(f"`{value}`" for value in key["enum"])
    if "anyOf" in key:
        types = (_format_type(option, schema) for option in key["anyOf"] if option.get("type") != "null")
        return " or ".join(dict.fromkeys(types))
    if key.get("type") == "array":
        items = _format_type(key["items"], schema)
        return f"list of ({items})" if "anyOf" in key["items"] else f"list of {items}"
    words: dict[str, str] = {"object": "mapping", "string": "text"}
    kind: str | list[str] = key["type"]
    if isinstance(kind, list):
        return " or ".join(words.get(word, word) for word in kind)
    return words.get(kind, kind) + _format_limits(key)


def _format_limits(key: dict[str, Any]) -> str:
    below, above = key.get("minimum"), key.get("maximum")
    if below is not None and above is not None:
        ends = (str(end) if isinstance(end, int) else f"{end:.12g}" for end in (below, above))
        return " " + " to ".join(ends)
    parts = []
    for name, sign in (
        ("minimum", "≥"),
        ("exclusiveMinimum", ">"),
        ("maximum", "≤"),
        ("exclusiveMaximum", "<"),
    ):
        if name in key:
            parts.append(f"{sign} {key[name]}")
    return f" {', '.join(parts)}" if parts else ""


if __name__ == "__main__":
    sys.stdout.write(format_reference())
