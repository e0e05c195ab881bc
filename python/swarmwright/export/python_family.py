"""What the formats Python and MicroPython have in common.

Arrays of numbers as expressions in Python and MicroPython.
"""

import numpy as np

from swarmwright.common.untrusted import one_line
from swarmwright.controllers.source.in_python import Numbers, PythonCode, Values
from swarmwright.controllers.source.text import decimals, quoted, wrapped
from swarmwright.export._base import Files, facts, part_of, render
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject

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


MICROPYTHON = ", for MicroPython"
"""In the first line of a module for MicroPython, which has the name of the one for Python."""


def modules(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> Files:
    """Return the module and its self-test; parameters have none. Arguments as of `module_text`."""
    files: Files = {f"{prefix}.py": module_text(subject, prefix, numbers, dialect)}
    if subject.steers:
        files[f"{prefix}_test.py"] = _test(subject, _values(subject, prefix))
    return files


def module_text(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> str:
    """Return the module.

    Args:
        subject: the controller.
        prefix: name of the module.
        numbers: how numbers are written.
        dialect: replacements that differ between Python and MicroPython.
    """
    values = _values(subject, prefix)
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


def _values(subject: Subject, prefix: str) -> dict[str, str]:
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
        unit = f"in {one_line(channel.unit)}, " if channel.unit else ""
        lines.append(f"    {quoted(channel.name)},  # {unit}{one_line(channel.limits)}")
    return "\n".join(lines)


def _test(subject: Subject, values: dict[str, str]) -> str:
    golden = {"golden": subject.golden_words, "sequences": golden_text(subject.golden)}
    return render("python_test.txt", {**values, **golden})


def parts(sequences: Sequences, size: int) -> list[slice]:
    """Return slices of whole sequences with at most so many steps, one sequence at least."""
    starts = [*np.flatnonzero(sequences.first).tolist(), len(sequences)]
    found, begin = [], 0
    for end, after in zip(starts[1:], [*starts[2:], None], strict=True):
        if after is None or after - begin > size:
            found.append(slice(begin, end))
            begin = end
    return found
