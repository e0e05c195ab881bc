"""Drawing ranks: the better, the likelier."""

import math


def triangular(ticket: int, members: int) -> int:
    """Return k for a ticket in 0 .. members * (members + 1) / 2 - 1, of which k holds members - k."""
    # Tickets from the end: the last holds one, the last but one two, ... so k counts triangular numbers from
    # there.
    left = members * (members + 1) // 2 - 1 - ticket
    row = (math.isqrt(8 * left + 1) - 1) // 2
    return members - 1 - row
