"""Numbers over time in the form in which the page's script reads them."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

EXACT = 300_000
"""Numbers up to which they are binary32; more are parts of their range in 2 bytes."""


def packed(values: NDArray[Any], kind: str) -> dict[str, Any]:
    """Return numbers as base64.

    kind: f4 or i4 for binary32 and integers, u1 for 0..255, q1 and q2 for parts of the range in 1 or 2 bytes,
    of which the largest stands for NaN.
    """
    if kind in {"f4", "i4", "u1"}:
        raw = np.ascontiguousarray(values, dtype={"f4": "<f4", "i4": "<i4", "u1": "u1"}[kind])
        return {"type": kind, "data": base64.b64encode(raw.tobytes()).decode()}
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if high <= low:
        high = low + 1.0
    none = 65535 if kind == "q2" else 255
    parts = np.round((values.astype(np.float64) - low) / (high - low) * (none - 1))
    parts = np.where(np.isfinite(values), parts, none)
    raw = parts.astype("<u2" if kind == "q2" else "u1")
    data = base64.b64encode(np.ascontiguousarray(raw).tobytes()).decode()
    return {"type": kind, "low": low, "high": high, "data": data}


def number_kind(count: int, coarse: str = "q2") -> str:
    """Return how so many numbers are packed."""
    return "f4" if count <= EXACT else coarse


def series(values: NDArray[Any], kind: str | None = None, coarse: str = "q2") -> dict[str, Any]:
    """Return numbers of things over time: once what never changes.

    values: (scenes, things). kind: as for `packed`; None: by how many there are, `coarse` for many.
    """
    first = values[0]
    same = values == first
    if values.dtype.kind == "f":
        same |= np.isnan(values) & np.isnan(first)
    which = np.flatnonzero(~same.all(axis=0))
    changing = values[:, which]
    base_kind = kind or "f4"
    result: dict[str, Any] = {"base": packed(first, base_kind), "which": packed(which, "i4")}
    if len(which):
        result["data"] = packed(changing.reshape(-1), kind or number_kind(changing.size, coarse))
    return result
