"""The JSON Schema of experiment files, generated from options models and registries."""

from typing import Any

from swarmwright.common.options import Options, add_descriptions
from swarmwright.experiment.document import DEFAULT_KINDS, Document
from swarmwright.experiment.launchers import LAUNCHERS
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.command.ros_definition import RosOptions

IDENTIFIER = "urn:swarmwright:experiment"
_IN_FILE = {"type": "string", "pattern": r"\.py:[^:]+$"}


def experiment_schema(*, only_built_in: bool = False) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of experiment files, with plug-ins unless `only_built_in`."""
    schema = _tidy(add_descriptions(Document).model_json_schema())
    definitions: dict[str, Any] = schema.pop("$defs", {})
    for name, registry in REGISTRIES.items():
        kinds = sorted(registry.built_in) if only_built_in else registry.names()
        variants = []
        for kind in kinds:
            model: type[Options] = registry.get(kind).options_model
            variant = _tidy(add_descriptions(model).model_json_schema())
            definitions |= variant.pop("$defs", {})
            variant.pop("title", None)
            if kind != DEFAULT_KINDS[name]:
                variant["required"] = sorted({*variant.get("required", []), "kind"})
            variants.append(variant)
        text = schema["properties"][name]["description"]
        schema["properties"][name] = {
            "description": f"{text} One of: {', '.join(kinds)}.",
            "type": "object",
            "default": {"kind": DEFAULT_KINDS[name]},
            "properties": {"kind": {"enum": kinds}},
            "oneOf": variants,
        }
        if registry.in_files:
            schema["properties"][name] |= {
                "description": f"{text} One of: {', '.join(kinds)}; or a class in a file, `file.py:Class`.",
                "type": ["object", "string"],
                "properties": {"kind": {"anyOf": [{"enum": kinds}, _IN_FILE]}},
                "oneOf": [
                    *variants,
                    {"type": "object", "required": ["kind"], "properties": {"kind": _IN_FILE}},
                    _IN_FILE,
                ],
            }
    _describe_launchers(schema["properties"]["servers"], definitions, only_built_in=only_built_in)
    for title, model in (("Command", CommandOptions), ("Fmu", FmuOptions), ("Ros", RosOptions)):
        mapping = _tidy(add_descriptions(model).model_json_schema())
        inner = {f"{title}{name}": definition for name, definition in mapping.pop("$defs", {}).items()}
        definitions |= _prefix_references({**inner, title: mapping}, title)
    schema["properties"]["simulation"] = {
        "description": schema["properties"]["simulation"]["description"],
        "anyOf": [
            {"type": "string", "minLength": 1},
            {"$ref": "#/$defs/Command"},
            {"$ref": "#/$defs/Fmu"},
            {"$ref": "#/$defs/Ros"},
        ],
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": IDENTIFIER,
        **schema,
        "title": "Swarmwright experiment",
        "$defs": definitions,
    }


def options_schema(model: type[Options]) -> dict[str, Any]:
    """Return the JSON Schema of one section."""
    return _tidy(add_descriptions(model).model_json_schema())  # type: ignore[no-any-return] # of a mapping


def _describe_launchers(servers: dict[str, Any], definitions: dict[str, Any], *, only_built_in: bool) -> None:
    """Add the options of launchers to the schema of `servers`."""
    kinds = sorted(LAUNCHERS.built_in) if only_built_in else LAUNCHERS.names()
    for kind in kinds:
        variant = options_schema(LAUNCHERS.get(kind).options_model)
        definitions |= variant.pop("$defs", {})
        variant["required"] = sorted({*variant.get("required", []), "launcher"})
        definitions[f"Launcher{kind}"] = variant
    text = {"type": "string", "pattern": f"^({'|'.join(kinds)}):[1-9][0-9]*"}
    entries = [text, *({"$ref": f"#/$defs/Launcher{kind}"} for kind in kinds)]
    servers["anyOf"] += [*entries, {"type": "array", "items": {"anyOf": entries}, "minItems": 1}]


def _prefix_references(node: Any, title: str) -> Any:  # noqa: ANN401 - any JSON value
    """Update the references of a schema to definitions renamed with a title as prefix."""
    if isinstance(node, dict):
        return {
            key: value.replace("#/$defs/", f"#/$defs/{title}")
            if key == "$ref"
            else _prefix_references(value, title)
            for key, value in node.items()
        }
    return [_prefix_references(item, title) for item in node] if isinstance(node, list) else node


def _tidy(node: Any) -> Any:  # noqa: ANN401 - any JSON value
    """Drop pydantic's generated titles, and join the lines of descriptions."""
    if isinstance(node, dict):
        return {
            key: " ".join(value.split()) if key == "description" and isinstance(value, str) else _tidy(value)
            for key, value in node.items()
            if not (key == "title" and isinstance(value, str))
        }
    if isinstance(node, list):
        return [_tidy(value) for value in node]
    return node
