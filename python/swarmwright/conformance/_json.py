"""Values in JSON messages: numbers, and hashes of episodes."""

import math
import secrets
from typing import Any, TypeGuard

Json = dict[str, Any]
"""A JSON object: a message, or a part of one."""


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether a JSON value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def new_hash() -> str:
    """Return a hash that no other episode has."""
    return secrets.token_hex(32)
