"""What the forms Python and MicroPython have in common."""

import numpy as np

from swarmwright.core.untrusted import one_line
from swarmwright.export._base import Files, facts
from swarmwright.export.python_code import Numbers, golden_text, python_code
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject
from swarmwright.export.text import quoted, render

MICROPYTHON = ", for MicroPython"
"""In the first line of a module for MicroPython, which has the name of the one for Python."""


def modules(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> Files:
    """Return the module and its self-test.

    Args:
        subject: the controller.
        prefix: name of the module.
        numbers: how numbers are written.
        dialect: replacements that differ between Python and MicroPython.
    """
    values = {"p": prefix, "facts": facts(subject, "    ").rstrip()}
    if not subject.steers:
        lines = [f"    {name!r}: {value!r}," for name, value in subject.values.items()]
        return {f"{prefix}.py": render("python_parameters.txt", {**values, "parameters": "\n".join(lines)})}
    code = python_code(subject, numbers)
    module = render(
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
            "init": code.init,
            "reset": code.reset,
            "step": code.step,
        },
    )
    return {f"{prefix}.py": module, f"{prefix}_test.py": _test(subject, values)}


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
