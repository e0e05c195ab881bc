"""Keys by which mappings with any plain values are sorted."""

import json
import re
from collections.abc import Collection, Mapping
from math import inf, isnan
from typing import Any

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
