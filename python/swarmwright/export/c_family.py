"""What the forms C and C++ have in common: their texts, and how they are compiled and run."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.errors import RunError
from swarmwright.export._base import facts
from swarmwright.export.c_code import Table
from swarmwright.export.programs import command, run, stepped, steps
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import RANDOM, Channel, Subject
from swarmwright.export.text import identifiers, literals, plain, render, wrapped

_OPTIONS = (["-O0"], ["-O2"], ["-O3", "-march=native", "-ffp-contract=fast"])
"""With which a harness is compiled: all must give the same bits."""


@dataclass(frozen=True)
class Language:
    """C or C++."""

    name: str
    ending: str
    """Of sources."""
    standard: str
    variable: str
    """Of the environment, which names a compiler."""
    compilers: tuple[str, ...]
    install: str

    def compile(self, folder: Path, sources: list[str], program: str, options: list[str]) -> bool:
        """Compile a program. Return False where the processor's own instructions cannot be asked for.

        Raises InputError without a compiler, RunError when it finds fault with a source.
        """
        words = [*command(self.variable, self.compilers, self.install), f"-std={self.standard}", *options]
        try:
            run([*words, "-I.", "-o", program, *sources], folder, f"the {self.name} compiler")
        except RunError as error:
            if "-march" in str(error) and "-march=native" in options:
                return False
            raise
        return True


def harness_values(prefix: str, subject_sizes: tuple[int, int], language: str) -> dict[str, str]:
    """Return replacements for self-tests and harnesses."""
    sensors, actuators = subject_sizes
    cpp = language == "C++"
    return {
        "header": f"{prefix}.hpp" if cpp else f"{prefix}.h",
        "sensors": str(sensors),
        "actuators": str(actuators),
        "declare": f"{prefix}::Controller controller;"
        if cpp
        else f"{prefix}_t controller;\n    {prefix}_reset(&controller);",
        "reset": "controller.reset()" if cpp else f"{prefix}_reset(&controller)",
    }


def driven(
    folder: Path, language: Language, values: Mapping[str, str], sources: list[str], sequences: Sequences
) -> NDArray[np.float32]:
    """Return what a controller does, compiled in several ways. Raises RunError when they differ."""
    cpp = language.name == "C++"
    call = "controller.step(in + 1, out + 1)" if cpp else f"{values['p']}_step(&controller, in + 1, out + 1)"
    (folder / f"harness.{language.ending}").write_text(
        render("c_harness.txt", {**values, "step": call}), encoding="utf-8"
    )
    data = steps(sequences)
    outputs: dict[str, NDArray[np.float32]] = {}
    for options in _OPTIONS:
        if language.compile(folder, [f"harness.{language.ending}", *sources], "harness", options):
            written = run(["./harness"], folder, "the compiled controller", data)
            outputs[" ".join(options)] = stepped(
                written, sequences, f"the controller compiled with {options[0]}"
            )
    worst = max(outputs, key=lambda one: _distance(sequences, outputs[one]))
    return outputs[worst]


def _distance(sequences: Sequences, found: NDArray[np.float32]) -> int:
    return int((found.view(np.uint32) != sequences.actuators.view(np.uint32))[sequences.accepted].sum())


def self_test(folder: Path, language: Language, prefix: str, sources: list[str]) -> str:
    """Compile and run the generated self-test; return its name. Raises RunError when it fails."""
    name = f"{prefix}_test.{language.ending}"
    language.compile(folder, [name, *sources], "self_test", ["-O2"])
    said = run(["./self_test"], folder, f"the self-test {name}")
    if said.strip() != b"ok":
        raise RunError(f"verification: the self-test {name} said {said!r}, expected ok")
    return name


def tests(subject: Subject, values: Mapping[str, str]) -> str:
    """Return the source of a self-test."""
    golden = subject.golden
    starts = [*np.flatnonzero(golden.first).tolist(), len(golden)]
    lengths = [str(end - begin) for begin, end in pairwise(starts)]
    cpp = values["header"].endswith(".hpp")
    call = "controller.step" if cpp else f"{values['p']}_step"
    first = "" if cpp else "&controller, "
    return render(
        "c_test.txt",
        {
            **values,
            "ending": "cpp" if cpp else "c",
            "facts": facts(subject),
            "golden": subject.golden_words,
            "lengths": wrapped(lengths),
            "sensor_rows": _rows(literals(golden.sensors.reshape(-1)), golden.sensors.shape[1]),
            "actuator_rows": _rows(
                [f"0x{bits:08x}u" for bits in golden.actuators.view(np.uint32).reshape(-1).tolist()],
                golden.actuators.shape[1],
            ),
            "step": f"{call}({first}sensors[step], actuators)",
        },
    )


def _rows(items: list[str], width: int) -> str:
    rows = [items[at : at + width] for at in range(0, len(items), width)]
    return "\n".join(
        f"    {{\n{wrapped(row, '        ')}\n    }}," if width > 6 else f"    {{{', '.join(row)}}},"
        for row in rows
    )


def enumeration(channels: list[Channel], begin: str, what: str) -> str:
    """Return the members of an enumeration with name, unit and limits as comments."""
    names = _words(channels, what)
    lines = []
    for index, (name, channel) in enumerate(zip(names, channels, strict=True)):
        about = f"{plain(channel.name)}{f' in {plain(channel.unit)}' if channel.unit else ''}"
        comma = "," if index + 1 < len(channels) else ""
        lines.append(f"    {begin}{name} = {index}{comma} /* {about}, {plain(channel.limits)} */")
    return "\n".join(lines)


def _words(channels: list[Channel], what: str) -> list[str]:
    """Return a different word for each; COUNT would be taken for how many there are."""
    found = identifiers((channel.name for channel in channels), what)
    return identifiers([f"{one}_{index}" if one == "COUNT" else one for index, one in enumerate(found)], what)


def conversion(subject: Subject) -> str:
    """Return a comment on how values become numbers of the controller; empty where none is scaled."""
    if not subject.conversion:
        return ""
    return "\n".join(["/*", *(f" * {line}" for line in subject.conversion), " */"])


def defined(table: Table, begin: str, flash: str) -> str:
    """Return the definition of a table; `begin` is what stands before its name."""
    return f"{begin}{table.name}[{table.length}] {flash} = {{\n{table.text}\n}};"


def assignments(channels: list[Channel], begin: str, what: str, array: str) -> str:
    """Return a line for each sensor that a person fills in."""
    names = _words(channels, what)
    lines = [
        f"    {array}[{begin}{name}] = {_value(channel)};"
        f" /* {plain(channel.name)}: {plain(channel.limits)} */"
        for name, channel in zip(names, channels, strict=True)
    ]
    return "\n".join(lines)


def _value(channel: Channel) -> str:
    if channel.name == RANDOM and channel.range is None:
        return "(float)random(16777216L) / 16777216.0f"
    return "0.0f"


def uses(channels: list[Channel], begin: str, what: str) -> str:
    """Return a line for each actuator that a person fills in."""
    names = _words(channels, what)
    lines = [
        f"    Serial.println(actuators[{begin}{name}], 6);"
        f" /* {plain(channel.name)}: {plain(channel.limits)} */"
        for name, channel in zip(names, channels, strict=True)
    ]
    return "\n".join(lines)
