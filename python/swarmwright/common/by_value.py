"""Equality of results that hold arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np


class ComparedByValue:
    """A dataclass (with `eq=False`) whose objects are equal when they have the same values, NaN among them.

    The equality that dataclasses generate fails on arrays, and two numbers that are NaN are not equal there.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment] # arrays have none

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        compared: list[str] = [one.name for one in fields(self) if one.compare]  # type: ignore[arg-type]
        return all(same(getattr(self, name), getattr(other, name)) for name in compared)

    def __ne__(self, other: object) -> bool:
        equal = self.__eq__(other)
        return equal if equal is NotImplemented else not equal


def same(one: Any, other: Any) -> bool:  # noqa: ANN401 - any values
    """Return whether two values are equal; arrays and NaN are among them."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return _same_arrays(one, other)
    if isinstance(one, str | bytes) or type(one) is not type(other):
        return bool(one == other)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, Sequence):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other or (one != one and other != other))


def _same_arrays(one: Any, other: Any) -> bool:  # noqa: ANN401 - arrays, or one of them
    if type(one) is not type(other) or one.dtype != other.dtype:
        return False
    return bool(np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
