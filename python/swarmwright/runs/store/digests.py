"""SHA-256 digests of a store's content, to detect damage.

docs/reference/run-folder.md defines the digested bytes. The digests are in the store itself, so they detect
damage by disks and copying, but not manipulation.
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
"""Errors of these functions for values that the store never writes."""


def digest_facts(facts: Mapping[str, str]) -> str:
    """Return the digest of all facts except the digest itself."""
    digested = sorted([name, value] for name, value in facts.items() if name != FACT)
    return hashlib.sha256(json.dumps(digested).encode()).hexdigest()


def digest_generation(
    previous: str, whole: tuple[int, ...], figures: Iterable[float | None], seeds: str, evaluations: str
) -> str:
    """Return the digest of a generation, which depends on all generations before it.

    Args:
        previous: digest of the generation before; empty for the first.
        whole: generation, first, evaluations, failed, leader, as in the table.
        figures: best, mean, best_so_far, lower_quartile, median, upper_quartile.
        seeds: JSON, as in the table.
        evaluations: digest of its evaluations.
    """
    # SQLite preserves neither NaN nor the sign of zero.
    normalized = [math.nan if figure is None or figure != figure else figure + 0.0 for figure in figures]
    numbers = _GENERATION.pack(*whole, *normalized)
    return hashlib.sha256(
        b"".join((previous.encode(), numbers, seeds.encode(), evaluations.encode()))
    ).hexdigest()
