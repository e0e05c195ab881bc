"""What the formats C and C++ have in common: their texts, and how they are compiled and run.

Parameter sets in C and C++: a constant with a member for each parameter.
"""

import os
import platform
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import RunError
from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.source.in_c import Code, Table
from swarmwright.controllers.source.text import identifiers, is_reserved, literals, plain, wrapped
from swarmwright.export._base import Files, facts, part_of, render
from swarmwright.export.golden import Golden
from swarmwright.export.programs import command, run, standard_option, stepped, steps
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import RANDOM, Channel, Subject
from swarmwright.export.walk import walk_of

_BITS = """static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}"""


def files(subject: Subject, prefix: str, *, cpp: bool = False) -> Files:
    """Return header, source (for C) and self-test."""
    values = {
        "p": prefix,
        "PREFIX": prefix.upper(),
        "facts": facts(subject),
        "header": f"{prefix}.hpp" if cpp else f"{prefix}.h",
        "ending": "cpp" if cpp else "c",
        "type": f"const {prefix}::Parameters set = {prefix}::parameters();"
        if cpp
        else f"const {prefix}_t set = {prefix};",
        "bits": _BITS if any(isinstance(value, float) for value in subject.values.values()) else "",
        "members": "\n".join(_declared(subject)),
        "values": ",\n".join(f"        {_literal(value)}" for value in subject.values.values()),
        "checks": "\n".join(_checks(subject.values)),
    }
    made: Files = {f"{prefix}_test.{values['ending']}": render("c_parameters_test.txt", values)}
    if cpp:
        return {f"{prefix}.hpp": render("cpp_parameters.txt", values), **made}
    return {
        f"{prefix}.h": render("c_parameters_header.txt", values),
        f"{prefix}.c": render("c_parameters_source.txt", values),
        **made,
    }


def members(values: Mapping[str, Any]) -> list[str]:
    """Return the name of the member for each parameter."""
    names = (name.lower() for name in identifiers(values, "PARAMETER"))
    return [f"{name}_" if is_reserved(name) else f"p{name}" if name[0].isdigit() else name for name in names]


def _declared(subject: Subject) -> Iterator[str]:
    for member, (name, value) in zip(members(subject.values), subject.values.items(), strict=True):
        kind = (
            "const char *" if isinstance(value, str) else "int32_t " if isinstance(value, int) else "float "
        )
        limits = f", {subject.ranges[name]}" if name in subject.ranges else ""
        yield f"    {kind}{member}; /* {plain(name)}{plain(limits)} */"


def _literal(value: object) -> str:
    if isinstance(value, str):
        return f'"{"".join(map(_escaped, value.encode()))}"'
    return str(value) if isinstance(value, int) else literals(np.array([value], np.float32))[0]


def _escaped(byte: int) -> str:
    """Return a byte as it is in a string of C; octal numbers end after three digits."""
    as_it_is = chr(byte).isalnum() or chr(byte) in " _-+.,:;()[]{}=<>!*#%&|~^/"
    return chr(byte) if byte < 128 and as_it_is else f"\\{byte:03o}"


def _checks(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield a comparison for each parameter: of text, of numbers, of bits."""
    for member, (name, value) in zip(members(values), values.items(), strict=True):
        if isinstance(value, str):
            wrong = f"strcmp(set.{member}, {_literal(value)}) != 0"
        elif isinstance(value, int):
            wrong = f"set.{member} != {value}"
        else:
            bits = np.array([value], np.float32).view(np.uint32)[0]
            wrong = f"bits_of(set.{member}) != 0x{bits:08x}u"
        yield f'    if ({wrong}) {{\n        puts("{plain(name)} is wrong");\n        return 1;\n    }}'


_OPTIONS = (["-O0"], ["-O2"], ["-O3", "-march=native", "-ffp-contract=fast"])
"""With which a harness is compiled: all must give the same bits."""


_RUNNER = "CONTROLLER_RUN"
"""Of the environment: a program, and its arguments, that runs what was compiled, such as an emulator."""
_PROCESSOR_NAMES = {
    "x86_64": ("x86_64", "i386", "i486", "i586", "i686", "amd64"),
    "AMD64": ("x86_64", "i386", "i486", "i586", "i686", "amd64"),
    "aarch64": ("aarch64", "arm64"),
    "arm64": ("aarch64", "arm64"),
    **dict.fromkeys(("armv6l", "armv7l", "armv8l"), ("arm",)),
    "ppc64le": ("ppc64le", "powerpc64le"),
}
"""How the targets of compilers begin whose programs run on a machine; else as the machine is called."""


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
        compiler = command(self.variable, self.compilers, self.install)
        words = [*compiler, *standard_option(compiler, self.standard), *options]
        try:
            run([*words, "-I.", "-o", program, *sources], folder, f"the {self.name} compiler")
        except RunError as error:
            if "-march" in str(error) and "-march=native" in options:
                return False
            self._check_processor(error)
            raise
        return True

    def execute(self, folder: Path, program: str, what: str, data: bytes = b"") -> bytes:
        """Run what was compiled, with the program that CONTROLLER_RUN names; return what it printed.

        Raises RunError when it fails, with what to do where the compiler is one for another processor.
        """
        runner = shlex.split(os.environ.get(_RUNNER, ""))
        try:
            return run([*runner, f"./{program}"], folder, what, data)
        except RunError as error:
            self._check_processor(error)
            raise

    def _check_processor(self, error: RunError) -> None:
        """Raise RunError where a program failed whose compiler is not for this processor.

        Not with CONTROLLER_RUN: what it names was meant for such programs, and the error is another one.
        """
        if os.environ.get(_RUNNER):
            return
        words = [*command(self.variable, self.compilers, self.install), "-dumpmachine"]
        try:
            target = run(words, Path.cwd(), "the compiler").decode(errors="replace").strip()
        except RunError:
            return
        machine = platform.machine()
        same = _PROCESSOR_NAMES.get(machine, (machine,))
        if target and not (target.startswith(same) and "-none" not in target.replace("-none-linux", "")):
            raise RunError(
                f"verification: {self.variable}={shlex.join(words[:-1])} compiles for another processor "
                f"({target}), and verification runs the program here ({machine}): name a compiler for this "
                f"machine, or an emulator with {_RUNNER}, such as {_RUNNER}=qemu-arm; on the robot, run the "
                f"self-test: {error}"
            ) from error


def code(subject: Subject, language: dict[str, str]) -> Code:
    """Return the code of a controller.

    Args:
        subject: that steers agents.
        language: replacements in templates that differ between C and C++.

    Raises:
        InputError: controllers of this kind are not known here.
    """
    made: Code = part_of(subject, "c", "C and C++")(subject, language)
    ready = "    uint8_t ready; /* set by reset: without it, a step is refused */"
    return replace(made, state="\n".join(filter(None, [made.state, ready])))


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
            written = language.execute(folder, "harness", "the compiled controller", data)
            outputs[" ".join(options)] = stepped(
                written, sequences, f"the controller compiled with {options[0]}"
            )
    worst = max(outputs, key=lambda output: _distance(sequences, outputs[output]))
    return outputs[worst]


def _distance(sequences: Sequences, found: NDArray[np.float32]) -> int:
    return int((found.view(np.uint32) != sequences.actuators.view(np.uint32))[sequences.accepted].sum())


def self_test(folder: Path, language: Language, prefix: str, sources: list[str]) -> str:
    """Compile and run the generated self-test; return its name. Raises RunError when it fails."""
    name = f"{prefix}_test.{language.ending}"
    language.compile(folder, [name, *sources], "self_test", ["-O2"])
    said = language.execute(folder, "self_test", f"the self-test {name}")
    if said.strip() != b"ok":
        raise RunError(f"verification: the self-test {name} said {said!r}, expected ok")
    return name


def tests(subject: Subject, values: Mapping[str, str]) -> str:
    """Return the source of a self-test."""
    made, walk = Golden.of(subject), walk_of(subject)
    golden = made.sequences
    starts = [*np.flatnonzero(golden.first).tolist(), len(golden)]
    lengths = [str(end - begin) for begin, end in pairwise(starts) if end > begin] or ["0"]
    # A table without a step has a row that is not used.
    sensor_rows = golden.sensors if len(golden) else np.zeros((1, golden.sensors.shape[1]), np.float32)
    actuator_rows = golden.actuators if len(golden) else np.zeros((1, golden.actuators.shape[1]), np.float32)
    correct = [f"0x{bits:08x}u" for bits in actuator_rows.view(np.uint32).reshape(-1).tolist()]
    cpp = values["header"].endswith(".hpp")
    call = "controller.step" if cpp else f"{values['p']}_step"
    first = "" if cpp else "&controller, "
    coverage = (
        f"Tried are the recorded steps (on AVR the first {_ON_AVR} only; SELF_TEST_STEPS sets another "
        f"number), {walk.words}, and each sensor as NaN and infinite, which must be refused."
    )
    return render(
        "c_test.txt",
        {
            **values,
            "ending": "cpp" if cpp else "c",
            "facts": facts(subject),
            "golden": made.words,
            "coverage": "\n".join(f" * {line}" for line in wrap(coverage, 105)),
            "count": str(len(golden)),
            "lengths": wrapped(lengths),
            "on_avr": str(_ON_AVR),
            "sensor_rows": _rows(literals(sensor_rows.reshape(-1)), sensor_rows.shape[1]),
            "actuator_rows": _rows(correct, actuator_rows.shape[1]),
            "probes": wrapped(literals(walk.probes)),
            "probes_of": "\n".join(f"    {{{begin}, {count}}}," for begin, count in walk.probes_of),
            "walk": str(walk.steps),
            "restart": str(walk.restart),
            "sum": f"0x{walk.checksum:08x}",
            "step": f"{call}({first}sensors, actuators)",
        },
    )


_ON_AVR = 20
"""Recorded steps that a self-test takes on AVR, whose flash has room for few."""
_ROWS_OF_PART = 10
"""Rows of tables of self-tests, after each of which they can be cut."""


def _rows(items: list[str], width: int) -> str:
    """Return the rows of a table that is cut after SELF_TEST_STEPS, in whole tens."""
    lines = []
    for row, at in enumerate(range(0, len(items), width)):
        if row and row % _ROWS_OF_PART == 0:
            lines += ["#endif"] * (row > _ROWS_OF_PART) + [f"#if SELF_TEST_STEPS > {row}"]
        cells = items[at : at + width]
        lines.append(
            f"    {{\n{wrapped(cells, '        ')}\n    }}," if width > 6 else f"    {{{', '.join(cells)}}},"
        )
    if len(items) > _ROWS_OF_PART * width:
        lines.append("#endif")
    return "\n".join(lines)


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
    words = identifiers((channel.name for channel in channels), what)
    return identifiers(
        [
            f"{identifier}_{index}" if identifier == "COUNT" else identifier
            for index, identifier in enumerate(words)
        ],
        what,
    )


def common(made: Code, values: Mapping[str, str]) -> dict[str, str]:
    """Return replacements in headers and sources that C and C++ share: the arithmetic, tables in flash."""
    upper = values["PREFIX"]
    reads = [
        (f"{upper}_READ{ending}(address)", function)
        for ending, function in (("", "float"), ("_16", "word"), ("_32", "dword"))
        if made.reads(f"{upper}_READ{ending}")
    ]
    # What is loaded is in memory: without other tables nothing has the macro.
    constant = not values.get("loaded") or any(table.evolved is None for table in made.tables)
    flash = {
        "flash_macro": f"#define {upper}_FLASH PROGMEM" if constant else "",
        "memory_macro": f"#define {upper}_FLASH" if constant else "",
        "flash_reads": "\n".join(f"#define {name} pgm_read_{function}(address)" for name, function in reads),
        "memory_reads": "\n".join(f"#define {name} (*(address))" for name, _ in reads),
    }
    return {
        "guards": render("c_guards.txt", values).rstrip(),
        "guards_end": render("c_guards_end.txt", values).rstrip(),
        "arithmetic": render("c_arithmetic.txt", values).rstrip() if made.kernel else "",
        "flash": render("c_flash.txt", {**values, **flash}).rstrip(),
        "ready": f"#define {upper}_READY 0xA5u /* in the struct once it was reset */",
        "finite": (
            render("c_finite.txt", values) + (render("c_nan.txt", values) if made.kernel else "")
        ).rstrip(),
        "kernel": made.kernel.rstrip(),
        "step": made.step.rstrip(),
    }


def refusals(made: Code, indent: str = "", *, needs_reset: bool = True) -> str:
    """Return when a step returns false, as lines of a comment.

    Args:
        made: the controller.
        indent: of the lines.
        needs_reset: it is also refused before the first reset.
    """
    without = ", or there was no reset" if needs_reset else ""
    words = (
        f"Returns false when a sensor is NaN or infinite{without}: state and actuators are then as before, "
        f"and the robot should stop.{made.refuses and ' '}{made.refuses}"
    )
    return "\n".join(f"{indent} * {line}" for line in wrap(words, 105 - len(indent)))


def step_seconds(subject: Subject, begin: str) -> str:
    """Return the definition of the duration of a control cycle; empty where it is not known."""
    if not subject.step_size:
        return ""
    (seconds,) = literals(np.array([subject.step_size], np.float32))
    return f"/* Seconds from step to step, as in the simulation. */\n{begin} {seconds}"


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


def stops(channels: list[Channel], begin: str, what: str) -> str:
    """Return a line for each actuator that sets it to 0, or of a scaled one to what stands for that."""
    lines = []
    for name, channel in zip(_words(channels, what), channels, strict=True):
        stop, about = 0.0, plain(channel.name)
        if channel.range is not None:
            low, high, unit = channel.range
            stop = float(np.clip(channel.range.from_value[1], -1, 1)) + 0.0
            nearest = 0.0 if -1 < stop < 1 else min(low, high, key=abs)
            about += f": {shortest_decimal(nearest)}{f' {plain(unit)}' if unit else ''}"
        (number,) = literals(np.array([stop], np.float32))
        lines.append(f"    actuators[{begin}{name}] = {number}; /* {about} */")
    return "\n".join(lines)
