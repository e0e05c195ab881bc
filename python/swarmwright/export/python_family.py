"""What the formats Python and MicroPython have in common.

Arrays of numbers as expressions in Python and MicroPython.
"""

import numpy as np

from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.source.in_python import Numbers, PythonCode, Values
from swarmwright.controllers.source.text import decimals, quoted, wrapped
from swarmwright.export._base import facts, part_of, render
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject

_NUMBERS_OF_A_LINE = 5
"""Longer arrays are written in several lines."""


def as_decimals(values: Values) -> str:
    """Return an array of shortest decimals, which Python reads as the nearest binary64 and then rounds."""
    code = _CODES[values.dtype.kind + str(values.itemsize)]
    whole = values.dtype.kind == "u"
    exact = whole or values.dtype == np.float64
    texts = [str(value) for value in values.tolist()] if exact else decimals(values.astype(np.float32))
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


def byte_text(values: Values) -> str:
    """Return the bytes of numbers, the lowest first, as Python writes them."""
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    return 'b"' + "".join(f"\\x{byte:02x}" for byte in data) + '"'


MICROPYTHON = ", for MicroPython"
"""In the first line of a module for MicroPython, which has the name of the one for Python."""


def module_text(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> str:
    """Return the module.

    Args:
        subject: the controller.
        prefix: name of the module.
        numbers: how numbers are written.
        dialect: replacements that differ between Python and MicroPython.
    """
    values = values_of(subject, prefix)
    if not subject.steers:
        lines = [f"    {name!r}: {value!r}," for name, value in subject.values.items()]
        return render("python_parameters.txt", {**values, "parameters": "\n".join(lines)})
    code: PythonCode = part_of(subject, "python", "Python")(subject, numbers)
    return render(
        "python.txt",
        {
            **values,
            **dialect,
            "imports": "\n".join(filter(None, [dialect["imports"], code.imports])),
            "conversion": "\n".join(f"# {line}" for line in subject.conversion),
            "sensor_names": _names(subject.sensors),
            "actuator_names": _names(subject.actuators),
            "numbers": code.numbers,
            "functions": "\n\n\n".join(
                filter(None, [render("python_checked.txt", {}).rstrip(), code.functions])
            ),
            "state_words": code.state_words,
            "refuses": code.refuses,
            "step_seconds": _step_seconds(subject),
            "init": code.init,
            "reset": code.reset,
            "step": code.step,
        },
    )


def values_of(subject: Subject, prefix: str) -> dict[str, str]:
    """Return what the texts of a module and of its self-test have in common."""
    return {"p": prefix, "facts": facts(subject, "    ").rstrip()}


def _step_seconds(subject: Subject) -> str:
    """Return the definition of the duration of a control cycle; empty where it is not known."""
    if not subject.step_size:
        return ""
    words = '"""Seconds from step to step, as in the simulation."""'
    return f"STEP_SECONDS = {subject.step_size!r}\n{words}\n"


def _names(channels: list[Channel]) -> str:
    lines = []
    for channel in channels:
        unit = f"in {escape_line(channel.unit)}, " if channel.unit else ""
        lines.append(f"    {quoted(channel.name)},  # {unit}{escape_line(channel.limits)}")
    return "\n".join(lines)


def parts(sequences: Sequences, size: int) -> list[slice]:
    """Return slices of whole sequences with at most so many steps, one sequence at least."""
    starts = [*np.flatnonzero(sequences.first).tolist(), len(sequences)]
    found, begin = [], 0
    for end, after in zip(starts[1:], [*starts[2:], None], strict=True):
        if after is None or after - begin > size:
            found.append(slice(begin, end))
            begin = end
    return found


PYTHON_WORDS = "Numbers are rounded to 32 bits after every operation, as in the simulation."


PYTHON = {
    "dialect": "",
    "imports": "from array import array\nfrom collections.abc import Sequence",
    "words": PYTHON_WORDS,
    "own": "",
    "exact": "",
    "none": " -> None",
    "sensors_type": ": Sequence[float]",
    "actuators_type": " -> list[float]",
}


def module_of(subject: Subject, prefix: str) -> str:
    """Return the module of a controller without code of its own, as `Python.files` does."""
    return module_text(subject, prefix, as_decimals, PYTHON)
