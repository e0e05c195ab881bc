"""Shared parts of the formats Python and MicroPython: modules, and arrays as expressions."""

import numpy as np

from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.source.in_python import Numbers, PythonCode, Values
from swarmwright.controllers.source.text import decimals, quote_python, wrap_items
from swarmwright.export._base import find_generator, format_facts, render
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject

_NUMBERS_OF_A_LINE = 5
"""Largest number of values of an array on a line."""


def as_decimals(values: Values) -> str:
    """Format an array of shortest decimals, which Python reads as binary64 and then rounds."""
    code = _CODES[values.dtype.kind + str(values.itemsize)]
    whole = values.dtype.kind == "u"
    exact = whole or values.dtype == np.float64
    texts = [str(value) for value in values.tolist()] if exact else decimals(values.astype(np.float32))
    if len(texts) <= _NUMBERS_OF_A_LINE:
        return f'array("{code}", [{", ".join(texts)}])'
    return f'array(\n    "{code}",\n    [\n{wrap_items(texts, " " * 8)}\n    ],\n)'


def as_bytes(values: Values) -> str:
    """Format an array as bytes, since MicroPython does not read every decimal exactly."""
    code = _CODES[values.dtype.kind + str(values.itemsize)]
    if len(values) <= _NUMBERS_OF_A_LINE:
        return f'array("{code}", unpack("<{len(values)}{code}", {byte_text(values)}))'
    lines = [f"        {byte_text(values[at : at + 5])}" for at in range(0, len(values), 5)]
    text = "\n".join(lines)
    return f'array(\n    "{code}",\n    unpack(\n        "<{len(values)}{code}",\n{text},\n    ),\n)'


_CODES = {"f4": "f", "f8": "d", "u2": "H", "u4": "L"}
"""Type codes of arrays and of `struct`, by kind and bytes."""


def byte_text(values: Values) -> str:
    """Return the little-endian bytes of numbers as a Python literal."""
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    return 'b"' + "".join(f"\\x{byte:02x}" for byte in data) + '"'


MICROPYTHON = ", for MicroPython"
"""Addition to the first line of a module for MicroPython."""


def module_text(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> str:
    """Return the module.

    Args:
        subject: the controller.
        prefix: name of the module.
        numbers: function that formats numbers.
        dialect: replacements that differ between Python and MicroPython.
    """
    values = values_of(subject, prefix)
    if not subject.steers:
        lines = [f"    {name!r}: {value!r}," for name, value in subject.values.items()]
        return render("python_parameters.txt", {**values, "parameters": "\n".join(lines)})
    code: PythonCode = find_generator(subject, "python", "Python")(subject, numbers)
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
    """Return the replacements shared by a module and its self-test."""
    return {"p": prefix, "facts": format_facts(subject, "    ").rstrip()}


def _step_seconds(subject: Subject) -> str:
    """Return the definition of the duration of a control cycle; empty if unknown."""
    if not subject.step_size:
        return ""
    words = '"""Seconds from step to step, as in the simulation."""'
    return f"STEP_SECONDS = {subject.step_size!r}\n{words}\n"


def _names(channels: list[Channel]) -> str:
    lines = []
    for channel in channels:
        unit = f"in {escape_line(channel.unit)}, " if channel.unit else ""
        lines.append(f"    {quote_python(channel.name)},  # {unit}{escape_line(channel.limits)}")
    return "\n".join(lines)


def split_sequences(sequences: Sequences, size: int) -> list[slice]:
    """Return slices of whole sequences with at most `size` steps, but at least one sequence."""
    starts = [*np.flatnonzero(sequences.first).tolist(), len(sequences)]
    slices, begin = [], 0
    for end, after in zip(starts[1:], [*starts[2:], None], strict=True):
        if after is None or after - begin > size:
            slices.append(slice(begin, end))
            begin = end
    return slices


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


def python_module(subject: Subject, prefix: str) -> str:
    """Return the Python module of a controller without user modules."""
    return module_text(subject, prefix, as_decimals, PYTHON)
