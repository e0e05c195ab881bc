"""Arrays of numbers as expressions in Python and MicroPython."""

import numpy as np

from swarmwright.controllers.source.in_python import Values
from swarmwright.controllers.source.text import decimals, wrapped
from swarmwright.export.sequences import Sequences

_NUMBERS_OF_A_LINE = 5
"""Longer arrays are written in several lines."""


def as_decimals(values: Values) -> str:
    """Return an array of shortest decimals, which Python reads as the nearest binary64 and then rounds."""
    code = _CODES[values.dtype.kind + str(values.itemsize)]
    whole = values.dtype.kind == "u"
    exact = whole or values.dtype == np.float64
    texts = [str(one) for one in values.tolist()] if exact else decimals(values.astype(np.float32))
    if len(texts) <= _NUMBERS_OF_A_LINE:
        return f'array("{code}", [{", ".join(texts)}])'
    return f'array(\n    "{code}",\n    [\n{wrapped(texts, " " * 8)}\n    ],\n)'


def as_bytes(values: Values) -> str:
    """Return an array of bytes: MicroPython does not read every decimal as the nearest number."""
    code = _CODES[values.dtype.kind + str(values.itemsize)]
    if len(values) <= _NUMBERS_OF_A_LINE:
        return f'array("{code}", unpack("<{len(values)}{code}", {byte_text(values)}))'
    lines = [f"        {byte_text(values[at : at + 5])}" for at in range(0, len(values), 5)]
    text = "\n".join(lines)
    return f'array(\n    "{code}",\n    unpack(\n        "<{len(values)}{code}",\n{text},\n    ),\n)'


_CODES = {"f4": "f", "f8": "d", "u2": "H", "u4": "L"}
"""Of arrays and of `struct`, by kind and bytes."""


def golden_text(golden: Sequences) -> str:
    """Return sequences as elements of a tuple in Python: tuples of (sensors, actuators), both as bytes."""
    if not len(golden):
        return ""
    lines: list[str] = []
    for index in range(len(golden)):
        if golden.first[index]:
            lines += [*(["    ),"] if lines else []), "    ("]
        row = f"{byte_text(golden.sensors[index])}, {byte_text(golden.actuators[index])}"
        lines.append(f"        ({row}),")
    return "\n".join([*lines, "    ),"])


def byte_text(values: Values) -> str:
    """Return the bytes of numbers, the lowest first, as Python writes them."""
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    return 'b"' + "".join(f"\\x{byte:02x}" for byte in data) + '"'
