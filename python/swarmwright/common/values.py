"""Nested values: dotted names, sort keys, equality, hashes, read-only containers."""

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
"""Digits to which whole numbers in texts are padded, so that texts sort by their size."""
_WHOLE = re.compile(r"(?<![\d.])\d+")
"""Digits, except after a decimal point."""


def sort_key(values: Mapping[str, Any], keys: Collection[str]) -> list[Key]:
    """Return a sort key for the values of keys: missing ones, None, numbers by size, others as JSON.

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
    """Return a hashable value that is equal for equal values; 1 and 1.0 are equal."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, Mapping):
        return frozenset((key, hashable(inner)) for key, inner in value.items())
    return tuple(map(hashable, value)) if isinstance(value, list | tuple) else value


def plain_values(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a copy of plain dicts and lists; NumPy numbers and arrays become Python's, paths text."""
    if isinstance(value, Mapping):
        return {key: plain_values(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain_values(inner) for inner in value]
    if hasattr(value, "tolist"):
        return plain_values(value.tolist())
    return str(value) if isinstance(value, PurePath) else value


def _refuse(*_: object, **__: object) -> NoReturn:
    raise TypeError(
        "an experiment is read-only; experiment.replace(parameters={'name': value}) returns a changed copy, "
        "experiment.to_mapping() a mutable mapping"
    )


class ReadOnlyDict(dict[Any, Any]):
    """A read-only dict, equal to a dict with the same items."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type, tuple[dict[Any, Any]]]:
        """Pickle and copy the items with the object: they cannot be set afterwards."""
        return type(self), (dict(self),)


class ReadOnlyList(list[Any]):
    """A read-only list, equal to a list with the same items."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple[type, tuple[list[Any]]]:
        """Pickle and copy the items with the object: they cannot be set afterwards."""
        return type(self), (list(self),)


def read_only(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a value with read-only dicts and lists; those in options (pydantic) are replaced in place."""
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
    """Return a copy with ordinary dicts and lists instead of read-only ones."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return list(map(plain, value)) if isinstance(value, list) else value


class ComparedByValue:
    """A dataclass (with `eq=False`) whose objects are equal if their values are, including arrays and NaN.

    The generated equality of dataclasses fails for arrays and NaN.
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


def are_equal(first: Any, second: Any) -> bool:  # noqa: ANN401 - any values
    """Return whether two values are equal, including arrays and NaN."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return _are_arrays_equal(first, second)
    if isinstance(first, str | bytes) or type(first) is not type(second):
        return bool(first == second)
    if isinstance(first, Mapping):
        return first.keys() == second.keys() and all(
            are_equal(value, second[key]) for key, value in first.items()
        )
    if isinstance(first, Sequence):
        return len(first) == len(second) and all(map(are_equal, first, second))
    return bool(first == second or (first != first and second != second))


def _are_arrays_equal(first: Any, second: Any) -> bool:  # noqa: ANN401 - arrays, or one of them
    if type(first) is not type(second) or first.dtype != second.dtype:
        return False
    return bool(np.array_equal(first, second, equal_nan=first.dtype.kind in "fc"))
