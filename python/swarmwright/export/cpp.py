"""C++11, header only: `--to cpp`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.export import c_family, c_parameters
from swarmwright.export._base import Exporter, Files, facts
from swarmwright.export.c_code import Code, code
from swarmwright.export.c_family import Language
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject
from swarmwright.export.text import check_header, render

LANGUAGE = Language("C++", "cpp", "c++11", "CXX", ("c++", "g++", "clang++"), "apt install g++")


class Cpp(Exporter):
    """`PREFIX.hpp` with a class in the namespace PREFIX, with a self-test and a CMakeLists.txt.

    It allocates nothing, throws nothing and needs no library.
    """

    form: ClassVar[str] = "cpp"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return header, self-test and CMakeLists.txt."""
        check_header(prefix)
        cmake = render("CMakeLists.txt", {})
        if not subject.steers:
            return {**c_parameters.files(subject, prefix, cpp=True), "CMakeLists.txt": cmake}
        values = _values(subject, prefix)
        sizes = (len(subject.sensors), len(subject.actuators))
        test = c_family.tests(subject, {**values, **c_family.harness_values(prefix, sizes, "C++")})
        return {
            f"{prefix}.hpp": _header(subject, values),
            f"{prefix}_test.cpp": test,
            "CMakeLists.txt": cmake,
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile the class without optimization, with it, and with fused operations allowed; run it."""
        sizes = (sequences.sensors.shape[1], sequences.actuators.shape[1])
        values = {"p": prefix, **c_family.harness_values(prefix, sizes, "C++")}
        return c_family.driven(folder, LANGUAGE, values, [], sequences)

    def self_test(self, folder: Path, prefix: str) -> str:
        """Compile and run `PREFIX_test.cpp`."""
        return c_family.self_test(folder, LANGUAGE, prefix, [])


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
        "facts": facts(subject),
    }


def _header(subject: Subject, values: dict[str, str]) -> str:
    made = code(subject, values)
    return render(
        "cpp_header.txt",
        {
            **values,
            "sensor_count": values["sensors"],
            "actuator_count": values["actuators"],
            "conversion": c_family.conversion(subject),
            "sensor_enum": c_family.enumeration(subject.sensors, "SENSOR_", "SENSOR"),
            "actuator_enum": c_family.enumeration(subject.actuators, "ACTUATOR_", "ACTUATOR"),
            "arithmetic": render("c_arithmetic.txt", values).rstrip() if made.kernel else "",
            "flash": render("c_flash.txt", values).rstrip(),
            "declared": "\n".join(
                f"    static const {one.type} {one.name}[{one.length}];" for one in made.tables
            ),
            "tables": _tables(made, values),
            "finite": render("c_finite.txt", values).rstrip(),
            "kernel": made.kernel.rstrip(),
            "state": made.state,
            "state_words": made.state_words,
            "step": made.step.rstrip(),
        },
    )


def _tables(made: Code, values: dict[str, str]) -> str:
    flash = f"{values['PREFIX']}_FLASH"
    begin = "template <typename Unused>\nconst {} Tables<Unused>::"
    return "\n\n".join(c_family.defined(one, begin.format(one.type), flash) for one in made.tables)
