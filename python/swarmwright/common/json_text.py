"""Untrusted JSON text, with a limit on nesting."""

import json
import math
import secrets
from collections.abc import Iterable
from typing import Any, TypeGuard

Json = dict[str, Any]
"""A JSON object: a message, or a part of one."""

_DEEPEST_NESTING = 100
"""Largest number of nesting levels."""


def loads(text: str | bytes) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of JSON text. Raises ValueError if it is invalid or nested too deeply."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise _depth_error() from None
    shown = text if isinstance(text, str) else text.decode("latin-1")
    if shown.count("[") + shown.count("{") > _DEEPEST_NESTING:
        _check_depth(value)
    return value


def _check_depth(value: Any) -> None:  # noqa: ANN401 - any JSON value
    level = [value]
    for _ in range(_DEEPEST_NESTING):
        level = [inner for item in level for inner in _inside(item) if isinstance(inner, dict | list)]
        if not level:
            return
    raise _depth_error()


def _inside(value: Any) -> Iterable[Any]:  # noqa: ANN401 - any JSON value
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _depth_error() -> ValueError:
    return ValueError(f"it is nested more than {_DEEPEST_NESTING} deep")


def is_number(value: object) -> TypeGuard[int | float]:
    """Return whether a JSON value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def new_hash() -> str:
    """Return a unique hash for an episode."""
    return secrets.token_hex(32)
