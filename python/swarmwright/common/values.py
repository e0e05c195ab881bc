"""Plain and nested values: dotted names, sort keys, equality, hashes, containers that cannot be changed."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from math import inf, isnan
from pathlib import PurePath
from typing import Any, NoReturn

import numpy as np
from pydantic import BaseModel


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested values by dotted name: {"method": {"kind": "x"}} as {"method.kind": "x"}."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            result |= flatten(value, f"{prefix}{name}.")
        else:
            result[f"{prefix}{name}"] = value
    return result


Key = tuple[int, int | float, str, str]
_DIGITS = 20
"""To which whole numbers in texts are filled up, so that texts are sorted by their size."""
_WHOLE = re.compile(r"(?<![\d.])\d+")
"""Digits, but not those behind a decimal point, which are sorted as they are."""


def sort_key(values: Mapping[str, Any], keys: Collection[str]) -> list[Key]:
    """Return by what the values of keys are sorted: missing ones, None, numbers by size, others as JSON.

    Different values have different sort keys.
    """
    return [_key(values[key]) if key in values else (-1, 0, "", "") for key in sorted(keys)]


def _key(value: Any) -> Key:  # noqa: ANN401 - any plain value
    if value is None:
        return 0, 0, "", ""
    text = json.dumps(value, sort_keys=True, default=str)
    if isinstance(value, int | float):
        return 1, -inf if isinstance(value, float) and isnan(value) else value, "", text
    return 2, 0, _WHOLE.sub(lambda number: number[0].zfill(_DIGITS), text), text


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


def _refuse(*_: object, **__: object) -> NoReturn:
    raise TypeError(
        "an experiment cannot be changed; experiment.replace(parameters={'name': value}) returns a changed "
        "copy, experiment.to_mapping() plain values that can be changed"
    )


class ReadOnlyDict(dict[Any, Any]):
    """A dict that cannot be changed; it equals one with the same items."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type, tuple[dict[Any, Any]]]:
        """Pickle and copy the items at once: none can be set afterwards."""
        return type(self), (dict(self),)


class ReadOnlyList(list[Any]):
    """A list that cannot be changed; it equals one with the same items."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple[type, tuple[list[Any]]]:
        """Pickle and copy the items at once: none can be set afterwards."""
        return type(self), (list(self),)


def read_only(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a value with read-only dictionaries and lists; options (pydantic) keep them in their place."""
    if isinstance(value, ReadOnlyDict | ReadOnlyList):
        return value
    if isinstance(value, Mapping):
        return ReadOnlyDict({key: read_only(inner) for key, inner in value.items()})
    if isinstance(value, list):
        return ReadOnlyList(map(read_only, value))
    if isinstance(value, BaseModel):
        fields = vars(value)  # their class refuses to set attributes
        for name, inner in fields.items():
            if isinstance(inner, BaseModel | Mapping | list):
                fields[name] = read_only(inner)
    return value


def plain(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a copy with ordinary dictionaries and lists in the place of read-only ones."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return list(map(plain, value)) if isinstance(value, list) else value


class ComparedByValue:
    """A dataclass (with `eq=False`) whose objects are equal when they have the same values, NaN among them.

    The equality that dataclasses generate fails on arrays, and two numbers that are NaN are not equal there.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment] # arrays have none

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        compared: list[str] = [field.name for field in fields(self) if field.compare]  # type: ignore[arg-type]
        return all(are_equal(getattr(self, name), getattr(other, name)) for name in compared)

    def __ne__(self, other: object) -> bool:
        equal = self.__eq__(other)
        return equal if equal is NotImplemented else not equal


def are_equal(one: Any, other: Any) -> bool:  # noqa: ANN401 - any values
    """Return whether two values are equal; arrays and NaN are among them."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return _are_arrays_equal(one, other)
    if isinstance(one, str | bytes) or type(one) is not type(other):
        return bool(one == other)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(are_equal(value, other[key]) for key, value in one.items())
    if isinstance(one, Sequence):
        return len(one) == len(other) and all(map(are_equal, one, other))
    return bool(one == other or (one != one and other != other))


def _are_arrays_equal(one: Any, other: Any) -> bool:  # noqa: ANN401 - arrays, or one of them
    if type(one) is not type(other) or one.dtype != other.dtype:
        return False
    return bool(np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
