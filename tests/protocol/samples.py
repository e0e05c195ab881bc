"""Genomes of samples in Python, from protocol.md alone, sharing nothing with the engine; makes their vectors.

    python -m tests.protocol.samples > protocol/vectors/samples.json

Every operation is one of binary32 or binary64 in the order that the page gives; Philox is NumPy's.
"""

import base64
import hashlib
import json
import math
import struct
import sys
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from tests.protocol import fields
from tests.protocol.controllers import Single, cos_pi, sin_pi

Json = dict[str, Any]

ROWS = ("center", "deviation", "middle", "reach", "lower", "upper")
_LN = (
    1.0, -0.49999988, 0.33333325, -0.25001585, 0.20002072,
    -0.16609126, 0.1418008, -0.13240843, 0.1291417, -0.07638592,
)  # fmt: skip
_UNIT = Single(2.0**-31)


def ln(x: Single) -> Single:
    """The natural logarithm."""
    above = int(x.view(np.uint32)) - 0x3F3504F3
    whole, mantissa = above >> 23, (above & 0x7FFFFF) + 0x3F3504F3
    f = np.uint32(mantissa).view(Single) - Single(1)
    value = Single(_LN[-1])
    for coefficient in _LN[-2::-1]:
        value = value * f + Single(coefficient)
    return f * value + Single(whole) * Single(0.6931472)


def normal(word: int) -> tuple[Single, Single]:
    """The two normal numbers of a random word."""
    length, turn = (word & 0xFFFFFFFF) >> 1, word >> 32
    turn -= (turn >> 31) << 32
    squared = Single(-2) * ln((Single(length) + Single(0.5)) * _UNIT)
    radius = np.sqrt(max(squared, Single(0)))
    return radius * cos_pi(Single(turn) * _UNIT), radius * sin_pi(Single(turn) * _UNIT)


def directions(sample: Json, row: int, genes: int) -> list[Single]:
    """The direction of a number."""
    purpose = int.from_bytes(hashlib.sha256(sample["purpose"].encode()).digest()[:8], "little")
    # NumPy counts up before it draws, so that its first block is block 1.
    counter = np.array([0, row, sample["generation"], 0], dtype=np.uint64)
    philox = np.random.Philox(counter=counter, key=np.array([sample["seed"], purpose], dtype=np.uint64))
    return [number for word in philox.random_raw((genes + 1) // 2) for number in normal(int(word))][:genes]


def genomes(sample: Json) -> NDArray[np.float32]:
    """(count, genes)"""
    center, deviation, middle, reach, lower, upper = (np.frombuffer(sample[name], "<f8") for name in ROWS)
    made = []
    for candidate in range(sample["first"], sample["first"] + sample["count"]):
        row = candidate // 2 if sample["mirrored"] else candidate
        away = deviation * np.array(directions(sample, row, len(center)), dtype=np.float64)
        point = center - away if sample["mirrored"] and candidate % 2 else center + away
        made.append(np.clip(middle + reach * point, lower, upper).astype(np.float32))
    return np.array(made, dtype=np.float32).reshape(len(made), len(center))


def row(*numbers: float) -> bytes:
    """Numbers as binary64."""
    return struct.pack(f"<{len(numbers)}d", *numbers)


SAMPLE: Json = {
    "distribution": "normal",
    "seed": 1,
    "purpose": "openai_es.direction",
    "generation": 3,
    "first": 0,
    "count": 4,
    "mirrored": True,
    "center": row(0.5, -0.25, 0.0),
    "deviation": row(0.5, 0.25, 2.0),
    "middle": row(0.0, 1.0, -1.0),
    "reach": row(1.0, 2.0, 1e-3),
    "lower": row(-3.0, -0.5, -1e38),
    "upper": row(2.0, 0.75, 1e38),
}
CASES: tuple[tuple[str, Json], ...] = (
    ("pairs", {}),
    ("pairs, from the second of one to the first of another", {"first": 7, "count": 4}),
    ("no pairs", {"mirrored": False, "purpose": "snes.direction", "count": 5}),
    ("the largest seed and generation, far candidates",
     {"seed": 2**64 - 1, "generation": 2**64 - 1, "first": 2**40 + 1, "count": 2}),
    ("so many numbers that some lie in the tails", {"count": 200, "mirrored": False, "seed": 12}),
    ("no candidates", {"count": 0}),
)  # fmt: skip
WRONG: tuple[tuple[str, Json], ...] = (
    ("a row of another length", {"reach": row(1.0, 2.0)}),
    ("half a number", {"center": row(0.5, -0.25, 0.0)[:-4]}),
    ("a number that is infinite", {"deviation": row(1.0, math.inf, 1.0)}),
    ("a number that is NaN", {"middle": row(1.0, math.nan, 1.0)}),
    ("a limit beyond binary32", {"upper": row(2.0, 1e39, 2.0)}),
    ("more genomes than a message has", {"count": 2**24}),
    ("numbers of candidates beyond 2^64", {"first": 2**64 - 1}),
)


def message(sample: Json, **changes: Any) -> bytes:
    """The request."""
    return bytes(msgpack.packb(fields.MESSAGES["evaluate"] | {"sample": sample} | changes))


def vectors() -> list[Json]:
    """The content of the file."""
    made: list[Json] = []
    for name, changes in CASES:
        sample = SAMPLE | changes
        hexadecimal = [[f"{bits:08x}" for bits in one.view("<u4").tolist()] for one in genomes(sample)]
        text = base64.b64encode(message(sample)).decode()
        made.append({"name": name, "accept": True, "bytes": text, "genomes": hexadecimal})
    for name, changes in WRONG:
        text = base64.b64encode(message(SAMPLE | changes)).decode()
        made.append({"name": name, "accept": False, "bytes": text})
    text = base64.b64encode(message(SAMPLE, genomes=struct.pack("<3f", 1, 2, 3))).decode()
    made.append({"name": "genomes besides a sample", "accept": False, "bytes": text})
    return made


def text() -> str:
    """The file."""
    return "[\n" + ",\n".join("  " + json.dumps(vector) for vector in vectors()) + "\n]\n"


if __name__ == "__main__":
    sys.stdout.write(text())
