"""Durations, counts and p-values as text."""

import math


def duration(seconds: float) -> str:
    """Return seconds as text: 8.2 s, 3 min 05 s, 2 h 07 min."""
    if not math.isfinite(seconds):
        return "?"
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


def counted(count: int, noun: str) -> str:
    """Return how many there are of something: 1 generation, 2,000 generations."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def p_value(value: float) -> str:
    """Return a p-value in two significant digits."""
    return "< 0.0001" if value < 1e-4 else f"{value:.2g}" if value < 0.1 else f"{value:.2f}"
