"""Plain values, which YAML and JSON can hold, made of what users give; and hashes of values."""

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from pydantic import BaseModel


def hashable(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return what has the same hash for equal values: 1 and 1.0 are equal."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, Mapping):
        return frozenset((key, hashable(inner)) for key, inner in value.items())
    return tuple(map(hashable, value)) if isinstance(value, list | tuple) else value


def plain_values(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a copy of plain dicts and lists; numpy numbers and arrays become Python's, paths text."""
    if isinstance(value, Mapping):
        return {key: plain_values(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain_values(inner) for inner in value]
    if hasattr(value, "tolist"):
        return plain_values(value.tolist())
    return str(value) if isinstance(value, PurePath) else value
