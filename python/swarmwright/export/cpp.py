"""C++11, header only: `--to cpp`."""

import re
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.source.in_c import Code
from swarmwright.controllers.source.text import check_global_name, check_header
from swarmwright.export import c_family
from swarmwright.export._base import Exporter, Files, format_facts, render
from swarmwright.export.c_family import Language, generate_code
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_CAST = re.compile(
    r"\((float|double|int|long|unsigned(?: long| int)?|size_t|u?int(?:8|16|32|64)_t)\)(?=[(\w])"
)
_OPERAND = re.compile(r"static_cast<[\w ]+>|[\w.]*(?:->\w+|::\w+)*")
LANGUAGE = Language("C++", "cpp", "c++11", "CXX", ("c++", "g++", "clang++"), "apt install g++")


class Cpp(Exporter):
    """`PREFIX.hpp` with a class in the namespace PREFIX, with a self-test and a CMakeLists.txt.

    It allocates nothing, throws nothing and needs no library.
    """

    form: ClassVar[str] = "cpp"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return header, self-test and CMakeLists.txt."""
        check_header(prefix)
        check_global_name(prefix)  # the name of the namespace
        cmake = render("CMakeLists.txt", {})
        if not subject.steers:
            return {**c_family.files(subject, prefix, cpp=True), "CMakeLists.txt": cmake}
        values = _values(subject, prefix)
        sizes = (len(subject.sensors), len(subject.actuators))
        test = c_family.format_self_test(subject, {**values, **c_family.harness_values(prefix, sizes, "C++")})
        return {
            f"{prefix}.hpp": _use_static_casts(_header(subject, values)),
            f"{prefix}_test.cpp": _use_static_casts(test),
            "CMakeLists.txt": cmake,
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile the class with several optimization levels, and run it."""
        sizes = (sequences.sensors.shape[1], sequences.actuators.shape[1])
        values = {"p": prefix, **c_family.harness_values(prefix, sizes, "C++")}
        return c_family.run_controller(folder, LANGUAGE, values, [], sequences)

    def self_test(self, folder: Path, prefix: str) -> str:
        """Compile and run `PREFIX_test.cpp`."""
        return c_family.self_test(folder, LANGUAGE, prefix, [])


def _use_static_casts(text: str) -> str:
    """Replace the casts of C with those of C++ (-Wold-style-cast)."""
    # From the last cast, whose operand has no casts left to replace.
    for match in reversed(list(_CAST.finditer(text))):
        end = _operand_end(text, match.end())
        operand = text[match.end() : end]
        if _bracket_end(text, match.end()) == end:
            operand = operand[1:-1]
        text = f"{text[: match.start()]}static_cast<{match[1]}>({operand}){text[end:]}"
    return text


def _operand_end(text: str, begin: int) -> int:
    """Return the end of the operand of a cast: a name or a bracket, with its calls and indices."""
    match = _OPERAND.match(text, begin)
    end = match.end() if match else begin
    while text[end : end + 1] in ("(", "["):
        end = _bracket_end(text, end)
    return end


def _bracket_end(text: str, begin: int) -> int:
    """Return the position after the matching bracket; the given position without a bracket."""
    if text[begin] not in "([":
        return begin
    depth = 0
    for at in range(begin, len(text)):
        depth += (text[at] in "([") - (text[at] in ")]")
        if not depth:
            return at + 1
    return len(text)


def _values(subject: Subject, prefix: str) -> dict[str, str]:
    return {
        "p": prefix,
        "PREFIX": prefix.upper(),
        "header": f"{prefix}.hpp",
        "function": "inline",
        "size_t": "size_t",
        "sensors": str(len(subject.sensors)),
        "actuators": str(len(subject.actuators)),
        "self": "",
        "data": "detail::Tables<void>::",
        "detail": "detail::",
        "reset_signature": "inline void Controller::reset() noexcept",
        "step_signature": "inline bool Controller::step(const float *sensors, float *actuators) noexcept",
        "facts": format_facts(subject),
    }


def _header(subject: Subject, values: dict[str, str]) -> str:
    generated = generate_code(subject, values)
    seconds = c_family.step_seconds(subject, "constexpr float step_seconds =")
    return render(
        "cpp_header.txt",
        {
            **values,
            "sensor_count": values["sensors"],
            "actuator_count": values["actuators"],
            "conversion": c_family.conversion(subject),
            "sensor_enum": c_family.enumeration(subject.sensors, "SENSOR_", "SENSOR"),
            "actuator_enum": c_family.enumeration(subject.actuators, "ACTUATOR_", "ACTUATOR"),
            **c_family.common(generated, values),
            "declared": "\n".join(
                f"    static const {table.type} {table.name}[{table.length}];" for table in generated.tables
            ),
            "tables": _tables(generated, values),
            "step_seconds": f"{seconds};" if seconds else "",
            "refusals": c_family.refusals(generated, "    ", needs_reset=False),
            "state": generated.state,
            "state_words": generated.state_words,
        },
    )


def _tables(generated: Code, values: dict[str, str]) -> str:
    flash = f"{values['PREFIX']}_FLASH"
    begin = "template <typename Unused>\nconst {} Tables<Unused>::"
    return "\n\n".join(
        c_family.define_table(table, begin.format(table.type), flash) for table in generated.tables
    )
