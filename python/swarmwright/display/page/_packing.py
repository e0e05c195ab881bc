"""Numbers of an episode, packed for the script: as text in a page, as bytes for an open player."""

import base64
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

EXACT = 300_000
"""Largest number of values that are stored as binary32; more are quantized to 2 bytes."""
TYPES = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1", "q2": "<u2", "q1": "u1"}
ALIGNMENT = 4
"""Bytes: arrays begin at multiples, so that the script reads them in location."""


@dataclass(frozen=True)
class Packed:
    """Packed numbers.

    kind: f4 or i4 for binary32 and integers, u1 and u2 for integers of 1 or 2 bytes, q1 and q2 for
    quantization to 1 or 2 bytes between `low` and `high`, of which the largest value is NaN.
    """

    kind: str
    raw: bytes
    low: float | None = None
    high: float | None = None

    def to_mapping(self) -> dict[str, Any]:
        """Return the kind and the ends of quantized numbers."""
        ends = {} if self.low is None else {"low": self.low, "high": self.high}
        return {"type": self.kind, **ends}


def pack(values: NDArray[Any], kind: str) -> Packed:
    """Pack numbers as one of the kinds of `Packed`."""
    if not kind.startswith("q"):
        return Packed(kind, np.ascontiguousarray(values, dtype=TYPES[kind]).tobytes())
    is_finite = np.isfinite(values)
    finite = values[is_finite]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if high <= low:
        high = low + 1.0
    none = 65535 if kind == "q2" else 255
    parts = (values.astype(np.float64) - low) * ((none - 1) / (high - low))
    quantized = np.where(is_finite, np.rint(parts, out=parts), none).astype(TYPES[kind])
    return Packed(kind, quantized.tobytes(), low, high)


def pack_integers(values: NDArray[Any]) -> Packed:
    """Pack integers, 0 or more, in 2 bytes each if they are small, in 4 otherwise."""
    return pack(values, "u2" if int(values.max(initial=0)) < 1 << 16 else "i4")


def to_json(data: dict[str, Any]) -> str:
    """Return plain and packed values as JSON, with packed numbers in base64."""

    def encode(value: Packed) -> dict[str, Any]:
        return {**value.to_mapping(), "data": base64.b64encode(value.raw).decode()}

    return _dump(data, encode)


def to_bytes(data: dict[str, Any]) -> bytes:
    """Return plain and packed values as bytes that a script reads without copying them.

    They are the length of the JSON, 4 bytes with the lowest first; the JSON; and all packed numbers, at the
    offsets that the JSON names, from its end.
    """
    blobs: list[bytes] = []
    end = 0

    def encode(value: Packed) -> dict[str, Any]:
        nonlocal end
        location = {**value.to_mapping(), "at": end, "size": len(value.raw)}
        padding = -len(value.raw) % ALIGNMENT
        blobs.extend([value.raw, b"\0" * padding])
        end += len(value.raw) + padding
        return location

    text = _dump(data, encode).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return b"".join([len(text).to_bytes(4, "little"), text, *blobs])


def _dump(data: dict[str, Any], encode: Any) -> str:  # noqa: ANN401 - as `json` takes it
    return json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"), default=encode)
