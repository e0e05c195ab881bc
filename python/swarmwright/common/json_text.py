"""JSON text from elsewhere, such as a received folder: nested no deeper than Python can handle."""

import json
from collections.abc import Iterable
from typing import Any

_DEEPEST_NESTING = 100
"""Levels of nesting."""


def loads(text: str | bytes) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of JSON text. Raises ValueError where it is not valid, or nested too deeply."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise _too_deep() from None
    shown = text if isinstance(text, str) else text.decode("latin-1")
    if shown.count("[") + shown.count("{") > _DEEPEST_NESTING:
        _check_depth(value)
    return value


def _check_depth(value: Any) -> None:  # noqa: ANN401 - any JSON value
    level = [value]
    for _ in range(_DEEPEST_NESTING):
        level = [inner for one in level for inner in _inside(one) if isinstance(inner, dict | list)]
        if not level:
            return
    raise _too_deep()


def _inside(value: Any) -> Iterable[Any]:  # noqa: ANN401 - any JSON value
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _too_deep() -> ValueError:
    return ValueError(f"it is nested more than {_DEEPEST_NESTING} deep")
