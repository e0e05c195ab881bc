"""Placing by trial: places drawn at random until one is free."""

from collections.abc import Callable
from typing import TypeVar

TRIES = 10_000
"""Places that are tried for a robot before it is said that there is none."""

Place = TypeVar("Place")


def free_place(draw: Callable[[], Place], is_free: Callable[[Place], bool]) -> Place | None:
    """Return the first place that is free of those that are drawn; None where none of `TRIES` is.

    Args:
        draw: returns another place each time.
        is_free: whether a place can be taken.
    """
    for _ in range(TRIES):
        place = draw()
        if is_free(place):
            return place
    return None
