"""SHA-256 of what a store holds, to detect damage.

docs/reference/run-folder.md says of which bytes. They are in the store itself, so they detect damage by disks
and copying, not manipulation.
"""

import hashlib
import json
import math
import struct
from collections.abc import Iterable, Mapping

FACT = "digest"
"""Name of the fact that holds the digest of all others."""
_GENERATION = struct.Struct("<5q6d")

WRONG_TYPES = (struct.error, TypeError, OverflowError)
"""What the functions here raise for values that no store was given."""


def of_facts(facts: Mapping[str, str]) -> str:
    """Return the digest of all facts but itself."""
    others = sorted([name, value] for name, value in facts.items() if name != FACT)
    return hashlib.sha256(json.dumps(others).encode()).hexdigest()


def of_generation(
    previous: str, whole: tuple[int, ...], figures: Iterable[float | None], seeds: str, evaluations: str
) -> str:
    """Return the digest of a generation, and so of all before it.

    Args:
        previous: digest of the generation before; empty for the first.
        whole: generation, first, evaluations, failed, leader, as in the table.
        figures: best, mean, best_so_far, lower_quartile, median, upper_quartile.
        seeds: JSON, as in the table.
        evaluations: digest of its evaluations.
    """
    # SQLite keeps neither NaN nor the sign of zero.
    kept = [math.nan if figure is None or figure != figure else figure + 0.0 for figure in figures]
    numbers = _GENERATION.pack(*whole, *kept)
    return hashlib.sha256(
        b"".join((previous.encode(), numbers, seeds.encode(), evaluations.encode()))
    ).hexdigest()
