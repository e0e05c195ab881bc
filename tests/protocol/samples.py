"""Genomes of samples in Python, from protocol.md alone, sharing nothing with the engine; makes their vectors.

    python -m tests.protocol.samples > protocol/vectors/samples.json

Every operation is one of binary64 in the order that the page gives; Philox is NumPy's.
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

Json = dict[str, Any]

ROWS = ("center", "deviation", "middle", "reach", "lower", "upper")
_CENTER = (
    (2509.0809287301227, 33430.57558358813, 67265.7709270087, 45921.95393154987, 13731.69376550946,
     1971.5909503065513, 133.14166789178438, 3.3871328727963665),
    (5226.495278852854, 28729.085735721943, 39307.89580009271, 21213.794301586597, 5394.196021424751,
     687.1870074920579, 42.31333070160091, 1.0),
)  # fmt: skip
_TAIL = (
    (0.0007745450142783414, 0.022723844989269184, 0.2417807251774506, 1.2704582524523684,
     3.6478483247632045, 5.769497221460691, 4.630337846156546, 1.4234371107496835),
    (1.0507500716444169e-09, 0.0005475938084995345, 0.015198666563616457, 0.14810397642748008,
     0.6897673349851, 1.6763848301838038, 2.053191626637759, 1.0),
)  # fmt: skip
_FAR = (
    (2.0103343992922881e-07, 2.7115555687434876e-05, 0.0012426609473880784, 0.026532189526576124,
     0.29656057182850487, 1.7848265399172913, 5.463784911164114, 6.657904643501103),
    (2.0442631033899397e-15, 1.421511758316446e-07, 1.8463183175100548e-05, 0.0007868691311456133,
     0.014875361290850615, 0.1369298809227358, 0.599832206555888, 1.0),
)  # fmt: skip


def _polynomial(coefficients: tuple[float, ...], at: float) -> float:
    value = coefficients[0]
    for coefficient in coefficients[1:]:
        value = value * at + coefficient
    return value


def _ratio(ratio: tuple[tuple[float, ...], tuple[float, ...]], at: float) -> float:
    return _polynomial(ratio[0], at) / _polynomial(ratio[1], at)


def _logarithm(number: float) -> float:
    mantissa, exponent = math.frexp(number)
    if mantissa < math.sqrt(0.5):
        mantissa, exponent = mantissa * 2, exponent - 1
    ratio = (mantissa - 1) / (mantissa + 1)
    series = _polynomial(tuple(1 / odd for odd in range(23, 0, -2)), ratio * ratio)
    return exponent * math.log(2) + 2 * ratio * series


def normal(word: int) -> float:
    """The normal number of a random word: AS 241 of the share that lies below it."""
    share = (word >> 11) * 2.0**-53 + 2.0**-54
    centered = share - 0.5
    if abs(centered) <= 0.425:
        return centered * _ratio(_CENTER, 0.180625 - centered * centered)
    rare = share if centered < 0 else 1 - share
    depth = math.sqrt(-_logarithm(max(rare, 2.0**-54)))
    size = _ratio(_TAIL, depth - 1.6) if depth <= 5 else _ratio(_FAR, depth - 5)
    return -size if centered < 0 else size


def directions(sample: Json, row: int, genes: int) -> list[float]:
    """The direction of a number."""
    purpose = int.from_bytes(hashlib.sha256(sample["purpose"].encode()).digest()[:8], "little")
    # NumPy counts up before it draws, so that its first block is block 1.
    counter = np.array([0, row, sample["generation"], 0], dtype=np.uint64)
    philox = np.random.Philox(counter=counter, key=np.array([sample["seed"], purpose], dtype=np.uint64))
    return [normal(int(word)) for word in philox.random_raw(genes)]


def genomes(sample: Json) -> NDArray[np.float32]:
    """(count, genes)"""
    center, deviation, middle, reach, lower, upper = (np.frombuffer(sample[name], "<f8") for name in ROWS)
    made = []
    for candidate in range(sample["first"], sample["first"] + sample["count"]):
        row = candidate // 2 if sample["mirrored"] else candidate
        away = deviation * np.array(directions(sample, row, len(center)))
        point = center - away if sample["mirrored"] and candidate % 2 else center + away
        made.append(np.clip(middle + reach * point, lower, upper).astype(np.float32))
    return np.array(made, dtype=np.float32).reshape(len(made), len(center))


def row(*numbers: float) -> bytes:
    """Numbers as binary64."""
    return struct.pack(f"<{len(numbers)}d", *numbers)


SAMPLE: Json = {
    "distribution": "gaussian",
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
