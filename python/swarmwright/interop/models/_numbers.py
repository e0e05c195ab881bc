"""Numbers in files of modelling tools, which are text there."""

import math

from swarmwright.interop.models._parts import Place, Problems


def whole_of(text: str, place: Place, problems: Problems) -> int | None:
    """Return a whole number; None after noting that a text is none."""
    try:
        value = int(text) if "_" not in text else None
    except ValueError:
        value = None
    if value is None or abs(value) >= 2**63:
        problems.add(place, f"{text[:80]!r} found, expected a whole number")
        return None
    return value


def number_of(text: str, place: Place, problems: Problems) -> float | None:
    """Return a finite number, Java's `0.15f` as 0.15; None after noting that a text is none."""
    digits = text[:-1] if text[-1:] in {"f", "F", "d", "D"} else text
    try:
        value = float(digits) if "_" not in digits else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        problems.add(place, f"{text[:80]!r} found, expected a number such as 0.15")
        return None
    return value
