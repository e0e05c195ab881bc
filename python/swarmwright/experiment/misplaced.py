"""Suggestions for keys in the wrong section of an experiment."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from typing import Any

from pydantic import BaseModel

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import UnknownKey, nearest
from swarmwright.experiment.document import (
    DEFAULT_KINDS,
    Document,
    Faults,
    Requirements,
    Timeouts,
    Validate,
)
from swarmwright.methods.plug_ins import REGISTRIES


def _keys(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


TOP = tuple(_keys(Document))
"""Keys at the top of an experiment."""
_SECTIONS: Mapping[str, type[BaseModel]] = {
    "requirements": Requirements,
    "validate": Validate,
    "timeouts": Timeouts,
    "faults": Faults,
}


def with_right_section(
    message: str, key: str, section: str, values: Mapping[str, Any], parameters: Collection[str]
) -> str:
    """Extend the message about an unknown key by the section to which it belongs.

    Args:
        message: about the key.
        key: its name.
        section: that contains it, empty for the top of the file.
        values: values of the whole file.
        parameters: known names of the simulation's parameters.
    """
    if not isinstance(message, UnknownKey):
        return message
    subject = message.subject
    kinds = _find_kinds_with(key, section)
    if kinds:
        return f"{subject}; it is an option of other kinds: {', '.join(kinds)}"
    sections = " or ".join(iter_right_sections(key, section, values, parameters))
    if not sections:
        return message
    suggestion = nearest(key, parameters if section == "parameters" else _keys_of(section, values))
    # For "episode", suggest "episodes" of this section before "episode" of another.
    if suggestion is None or not (suggestion.startswith(key) or key.startswith(suggestion)):
        return f"{subject}; it belongs to another section: {sections}"
    # Names of parameters may coincide with keys elsewhere.
    return message if section == "parameters" else f"{message} Another section has {sections}"


def iter_right_sections(
    key: str, section: str, values: Mapping[str, Any], parameters: Collection[str]
) -> Iterator[str]:
    """Yield the paths where a key belongs, `method.population`; arguments as in `with_right_section`."""
    if section and key in TOP:
        yield f"{key} (at the top of the file)"
        return
    if section != "parameters" and key in parameters:
        yield f"parameters.{key}"
    for name, model in _models(values):
        if name != section and key != "kind" and key in _keys(model):
            yield f"{name}.{key}"


def _keys_of(section: str, values: Mapping[str, Any]) -> Collection[str]:
    """Return the keys of a section, or of the top if `section` is empty."""
    if not section:
        return TOP
    return next((_keys(model) for name, model in _models(values) if name == section), ())


def _find_kinds_with(key: str, section: str) -> list[str]:
    """Return the kinds of a method, controller or ranking with an option of this name."""
    if section not in REGISTRIES:
        return []
    registry, kinds = REGISTRIES[section], []
    for kind in registry.names():
        with suppress(InputError):  # its package cannot be imported
            if key in _keys(registry.get(kind).options_model):
                kinds.append(kind)
    return kinds


def _models(values: Mapping[str, Any]) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the sections of an experiment with their options model, by kind if there are several."""
    for name, registry in REGISTRIES.items():
        section = values.get(name)
        kind = (
            section.get("kind", DEFAULT_KINDS[name]) if isinstance(section, Mapping) else DEFAULT_KINDS[name]
        )
        if not isinstance(kind, str):
            continue
        try:
            yield name, registry.get(kind).options_model
        except InputError:  # is reported
            continue
    yield from _SECTIONS.items()
