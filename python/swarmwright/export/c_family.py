"""Shared parts of the formats C and C++: generated text, compilation and execution."""

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
from swarmwright.controllers.source.text import is_reserved, literals, make_identifiers, plain, wrap_items
from swarmwright.export._base import Files, find_generator, format_facts, render
from swarmwright.export.golden import Golden, generate_walk
from swarmwright.export.programs import find_command, format_steps, parse_actuators, run, standard_option
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import RANDOM, Channel, Subject

_BITS = """static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}"""


def files(subject: Subject, prefix: str, *, cpp: bool = False) -> Files:
    """Return header, source (for C) and self-test of a parameter set."""
    values = {
        "p": prefix,
        "PREFIX": prefix.upper(),
        "facts": format_facts(subject),
        "header": f"{prefix}.hpp" if cpp else f"{prefix}.h",
        "ending": "cpp" if cpp else "c",
        "type": f"const {prefix}::Parameters set = {prefix}::parameters();"
        if cpp
        else f"const {prefix}_t set = {prefix};",
        "bits": _BITS if any(isinstance(value, float) for value in subject.values.values()) else "",
        "members": "\n".join(_declare_members(subject)),
        "values": ",\n".join(f"        {_literal(value)}" for value in subject.values.values()),
        "checks": "\n".join(_checks(subject.values)),
    }
    test_file: Files = {f"{prefix}_test.{values['ending']}": render("c_parameters_test.txt", values)}
    if cpp:
        return {f"{prefix}.hpp": render("cpp_parameters.txt", values), **test_file}
    return {
        f"{prefix}.h": render("c_parameters_header.txt", values),
        f"{prefix}.c": render("c_parameters_source.txt", values),
        **test_file,
    }


def members(values: Mapping[str, Any]) -> list[str]:
    """Return the name of the member for each parameter."""
    names = (name.lower() for name in make_identifiers(values, "PARAMETER"))
    return [f"{name}_" if is_reserved(name) else f"p{name}" if name[0].isdigit() else name for name in names]


def _declare_members(subject: Subject) -> Iterator[str]:
    for member, (name, value) in zip(members(subject.values), subject.values.items(), strict=True):
        kind = (
            "const char *" if isinstance(value, str) else "int32_t " if isinstance(value, int) else "float "
        )
        limits = f", {subject.ranges[name]}" if name in subject.ranges else ""
        yield f"    {kind}{member}; /* {plain(name)}{plain(limits)} */"


def _literal(value: object) -> str:
    if isinstance(value, str):
        return f'"{"".join(map(_escape_byte, value.encode()))}"'
    return str(value) if isinstance(value, int) else literals(np.array([value], np.float32))[0]


def _escape_byte(byte: int) -> str:
    """Escape a byte of a C string; octal escapes have three digits."""
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
"""Options with which a harness is compiled; all must give the same bits."""


_RUNNER = "CONTROLLER_RUN"
"""Environment variable with a command that runs compiled programs, such as an emulator."""
_PROCESSOR_NAMES = {
    "x86_64": ("x86_64", "i386", "i486", "i586", "i686", "amd64"),
    "AMD64": ("x86_64", "i386", "i486", "i586", "i686", "amd64"),
    "aarch64": ("aarch64", "arm64"),
    "arm64": ("aarch64", "arm64"),
    **dict.fromkeys(("armv6l", "armv7l", "armv8l"), ("arm",)),
    "ppc64le": ("ppc64le", "powerpc64le"),
}
"""Prefixes of compiler targets whose programs run on a machine; default: the name of the machine."""


@dataclass(frozen=True)
class Language:
    """C or C++."""

    name: str
    ending: str
    """Suffix of sources."""
    standard: str
    variable: str
    """Environment variable that names a compiler."""
    compilers: tuple[str, ...]
    install: str

    def compile(self, folder: Path, sources: list[str], program: str, options: list[str]) -> bool:
        """Compile a program. Return False if native instructions are not supported.

        Raises InputError without a compiler, RunError when the compilation fails.
        """
        compiler = find_command(self.variable, self.compilers, self.install)
        words = [*compiler, *standard_option(compiler, self.standard), *options]
        try:
            run([*words, "-I.", "-o", program, *sources], folder, f"the {self.name} compiler")
        except RunError as error:
            if "-march" in str(error) and "-march=native" in options:
                return False
            self._check_processor(error)
            raise
        return True

    def execute(self, folder: Path, program: str, label: str, data: bytes = b"") -> bytes:
        """Run a compiled program, with the command of CONTROLLER_RUN; return its output.

        Raises RunError when it fails, with advice if the compiler is for another processor.
        """
        runner = shlex.split(os.environ.get(_RUNNER, ""))
        try:
            return run([*runner, f"./{program}"], folder, label, data)
        except RunError as error:
            self._check_processor(error)
            raise

    def _check_processor(self, error: RunError) -> None:
        """Raise RunError with advice if the compiler is for another processor.

        With CONTROLLER_RUN, which is meant for such programs, the failure has another cause.
        """
        if os.environ.get(_RUNNER):
            return
        words = [*find_command(self.variable, self.compilers, self.install), "-dumpmachine"]
        try:
            target = run(words, Path.cwd(), "the compiler").decode(errors="replace").strip()
        except RunError:
            return
        machine = platform.machine()
        same = _PROCESSOR_NAMES.get(machine, (machine,))
        if target and not (target.startswith(same) and "-none" not in target.replace("-none-linux", "")):
            raise RunError(
                f"verification: {self.variable}={shlex.join(words[:-1])} compiles for another processor "
                f"({target}) than that of this machine ({machine}): set a compiler for this machine, or an "
                f"emulator with {_RUNNER}, such as {_RUNNER}=qemu-arm, or run the self-test on the robot: "
                f"{error}"
            ) from error


def generate_code(subject: Subject, language: dict[str, str]) -> Code:
    """Return the code of a controller.

    Args:
        subject: a controller that steers agents.
        language: replacements in templates that differ between C and C++.

    Raises:
        InputError: controllers of this kind are not supported.
    """
    generated: Code = find_generator(subject, "c", "C and C++")(subject, language)
    ready = "    uint8_t ready; /* set by reset: without it, a step is refused */"
    return replace(generated, state="\n".join(filter(None, [generated.state, ready])))


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


def run_controller(
    folder: Path, language: Language, values: Mapping[str, str], sources: list[str], sequences: Sequences
) -> NDArray[np.float32]:
    """Run a controller compiled with several options; return the actuators with the most differences."""
    cpp = language.name == "C++"
    call = "controller.step(in + 1, out + 1)" if cpp else f"{values['p']}_step(&controller, in + 1, out + 1)"
    (folder / f"harness.{language.ending}").write_text(
        render("c_harness.txt", {**values, "step": call}), encoding="utf-8"
    )
    data = format_steps(sequences)
    outputs: dict[str, NDArray[np.float32]] = {}
    for options in _OPTIONS:
        if language.compile(folder, [f"harness.{language.ending}", *sources], "harness", options):
            written = language.execute(folder, "harness", "the compiled controller", data)
            outputs[" ".join(options)] = parse_actuators(
                written, sequences, f"the controller compiled with {options[0]}"
            )
    worst = max(outputs, key=lambda output: _distance(sequences, outputs[output]))
    return outputs[worst]


def _distance(sequences: Sequences, actuators: NDArray[np.float32]) -> int:
    return int((actuators.view(np.uint32) != sequences.actuators.view(np.uint32))[sequences.accepted].sum())


def self_test(folder: Path, language: Language, prefix: str, sources: list[str]) -> str:
    """Compile and run the generated self-test; return its name. Raises RunError when it fails."""
    name = f"{prefix}_test.{language.ending}"
    language.compile(folder, [name, *sources], "self_test", ["-O2"])
    output = language.execute(folder, "self_test", f"the self-test {name}")
    if output.strip() != b"ok":
        raise RunError(f"verification: the self-test {name} printed {output!r}, expected ok")
    return name


def format_self_test(subject: Subject, values: Mapping[str, str]) -> str:
    """Return the source of a self-test."""
    golden_vectors, walk = Golden.from_subject(subject), generate_walk(subject)
    golden = golden_vectors.sequences
    starts = [*np.flatnonzero(golden.first).tolist(), len(golden)]
    lengths = [str(end - begin) for begin, end in pairwise(starts) if end > begin] or ["0"]
    # An empty table has an unused row.
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
            "facts": format_facts(subject),
            "golden": golden_vectors.words,
            "coverage": "\n".join(f" * {line}" for line in wrap(coverage, 105)),
            "count": str(len(golden)),
            "lengths": wrap_items(lengths),
            "on_avr": str(_ON_AVR),
            "sensor_rows": _rows(literals(sensor_rows.reshape(-1)), sensor_rows.shape[1]),
            "actuator_rows": _rows(correct, actuator_rows.shape[1]),
            "probes": wrap_items(literals(walk.probes)),
            "sensor_probes": "\n".join(f"    {{{begin}, {count}}}," for begin, count in walk.sensor_probes),
            "walk": str(walk.steps),
            "restart": str(walk.restart),
            "sum": f"0x{walk.checksum:08x}",
            "step": f"{call}({first}sensors, actuators)",
        },
    )


_ON_AVR = 20
"""Recorded steps of a self-test on AVR, whose flash is small."""
_ROWS_OF_PART = 10
"""Rows after which the tables of self-tests can be cut."""


def _rows(items: list[str], width: int) -> str:
    """Return the rows of a table that is cut after SELF_TEST_STEPS, in multiples of ten."""
    lines = []
    for row, at in enumerate(range(0, len(items), width)):
        if row and row % _ROWS_OF_PART == 0:
            lines += ["#endif"] * (row > _ROWS_OF_PART) + [f"#if SELF_TEST_STEPS > {row}"]
        cells = items[at : at + width]
        lines.append(
            f"    {{\n{wrap_items(cells, '        ')}\n    }},"
            if width > 6
            else f"    {{{', '.join(cells)}}},"
        )
    if len(items) > _ROWS_OF_PART * width:
        lines.append("#endif")
    return "\n".join(lines)


def enumeration(channels: list[Channel], begin: str, fallback: str) -> str:
    """Return the members of an enumeration with name, unit and limits as comments."""
    names = _channel_words(channels, fallback)
    lines = []
    for index, (name, channel) in enumerate(zip(names, channels, strict=True)):
        about = f"{plain(channel.name)}{f' in {plain(channel.unit)}' if channel.unit else ''}"
        comma = "," if index + 1 < len(channels) else ""
        lines.append(f"    {begin}{name} = {index}{comma} /* {about}, {plain(channel.limits)} */")
    return "\n".join(lines)


def _channel_words(channels: list[Channel], fallback: str) -> list[str]:
    """Return a unique word for each channel; COUNT is reserved for their number."""
    words = make_identifiers((channel.name for channel in channels), fallback)
    return make_identifiers(
        [
            f"{identifier}_{index}" if identifier == "COUNT" else identifier
            for index, identifier in enumerate(words)
        ],
        fallback,
    )


def common(generated: Code, values: Mapping[str, str]) -> dict[str, str]:
    """Return replacements in headers and sources that C and C++ share: the arithmetic, tables in flash."""
    upper = values["PREFIX"]
    reads = [
        (f"{upper}_READ{ending}(address)", function)
        for ending, function in (("", "float"), ("_16", "word"), ("_32", "dword"))
        if generated.uses_macro(f"{upper}_READ{ending}")
    ]
    # Loaded tables are in memory; without other tables the macro is not used.
    constant = not values.get("loaded") or any(table.evolved is None for table in generated.tables)
    flash = {
        "flash_macro": f"#define {upper}_FLASH PROGMEM" if constant else "",
        "memory_macro": f"#define {upper}_FLASH" if constant else "",
        "flash_reads": "\n".join(f"#define {name} pgm_read_{function}(address)" for name, function in reads),
        "memory_reads": "\n".join(f"#define {name} (*(address))" for name, _ in reads),
    }
    return {
        "guards": render("c_guards.txt", values).rstrip(),
        "guards_end": render("c_guards_end.txt", values).rstrip(),
        "arithmetic": render("c_arithmetic.txt", values).rstrip() if generated.kernel else "",
        "flash": render("c_flash.txt", {**values, **flash}).rstrip(),
        "ready": f"#define {upper}_READY 0xA5u /* in the struct once it was reset */",
        "finite": (
            render("c_finite.txt", values) + (render("c_nan.txt", values) if generated.kernel else "")
        ).rstrip(),
        "kernel": generated.kernel.rstrip(),
        "step": generated.step.rstrip(),
    }


def refusals(generated: Code, indent: str = "", *, needs_reset: bool = True) -> str:
    """Describe when a step returns false, as lines of a comment.

    Args:
        generated: code of the controller.
        indent: indentation of the lines.
        needs_reset: whether steps are also refused before the first reset.
    """
    without = ", or there was no reset" if needs_reset else ""
    words = (
        f"Returns false when a sensor is NaN or infinite{without}: state and actuators are then as before, "
        f"and the robot should stop.{generated.refuses and ' '}{generated.refuses}"
    )
    return "\n".join(f"{indent} * {line}" for line in wrap(words, 105 - len(indent)))


def step_seconds(subject: Subject, begin: str) -> str:
    """Return the definition of the duration of a control cycle; empty if unknown."""
    if not subject.step_size:
        return ""
    (seconds,) = literals(np.array([subject.step_size], np.float32))
    return f"/* Seconds from step to step, as in the simulation. */\n{begin} {seconds}"


def conversion(subject: Subject) -> str:
    """Return a comment on the conversion of values; empty if no value is scaled."""
    if not subject.conversion:
        return ""
    return "\n".join(["/*", *(f" * {line}" for line in subject.conversion), " */"])


def define_table(table: Table, begin: str, flash: str) -> str:
    """Return the definition of a table; begin: text before its name."""
    return f"{begin}{table.name}[{table.length}] {flash} = {{\n{table.text}\n}};"


def assignments(channels: list[Channel], begin: str, fallback: str, array: str) -> str:
    """Return a line to fill in for each sensor."""
    names = _channel_words(channels, fallback)
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


def uses(channels: list[Channel], begin: str, fallback: str) -> str:
    """Return a line to fill in for each actuator."""
    names = _channel_words(channels, fallback)
    lines = [
        f"    Serial.println(actuators[{begin}{name}], 6);"
        f" /* {plain(channel.name)}: {plain(channel.limits)} */"
        for name, channel in zip(names, channels, strict=True)
    ]
    return "\n".join(lines)


def stops(channels: list[Channel], begin: str, fallback: str) -> str:
    """Return a line for each actuator that sets it to 0, or to the scaled equivalent."""
    lines = []
    for name, channel in zip(_channel_words(channels, fallback), channels, strict=True):
        stop, about = 0.0, plain(channel.name)
        if channel.range is not None:
            low, high, unit = channel.range
            stop = float(np.clip(channel.range.from_value[1], -1, 1)) + 0.0
            nearest = 0.0 if -1 < stop < 1 else min(low, high, key=abs)
            about += f": {shortest_decimal(nearest)}{f' {plain(unit)}' if unit else ''}"
        (number,) = literals(np.array([stop], np.float32))
        lines.append(f"    actuators[{begin}{name}] = {number}; /* {about} */")
    return "\n".join(lines)
