"""C99: `--to c`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.source.in_c import Table
from swarmwright.controllers.source.text import check_global_name, check_header, check_type, seal
from swarmwright.export import c_family
from swarmwright.export._base import Exporter, Files, format_facts, render
from swarmwright.export.c_family import Language, generate_code
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import RANDOM, Subject

LANGUAGE = Language("C", "c", "gnu11", "CC", ("cc", "gcc", "clang"), "apt install gcc")


class C(Exporter):
    """`PREFIX.c` and `PREFIX.h` in C99, with a self-test, a CMakeLists.txt and an Arduino sketch.

    It needs no allocation and no library; the state is in a struct. Several controllers in one program have
    different prefixes.
    """

    form: ClassVar[str] = "c"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return sources, self-test, CMakeLists.txt and, for controllers of agents, a sketch."""
        check_header(prefix)
        check_type(prefix)
        cmake = render("CMakeLists.txt", {})
        if not subject.steers:
            check_global_name(prefix)  # the name of the constant
            return {**c_family.files(subject, prefix), "CMakeLists.txt": cmake}
        values = _values(subject, prefix)
        header, source = _header(subject, values), _source(subject, values)
        sketch = f"{prefix}_arduino"
        sizes = (len(subject.sensors), len(subject.actuators))
        test = c_family.format_self_test(subject, {**values, **c_family.harness_values(prefix, sizes, "C")})
        return {
            f"{prefix}.h": header,
            f"{prefix}.c": source,
            f"{prefix}_test.c": test,
            "CMakeLists.txt": cmake,
            f"{sketch}/{sketch}.ino": _sketch(subject, values, sketch),
            f"{sketch}/{prefix}.h": header,
            f"{sketch}/{prefix}.c": source,
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Compile the source with several optimization levels, and run it."""
        sizes = (sequences.sensors.shape[1], sequences.actuators.shape[1])
        values = {"p": prefix, **c_family.harness_values(prefix, sizes, "C")}
        return c_family.run_controller(folder, LANGUAGE, values, [f"{prefix}.c"], sequences)

    def self_test(self, folder: Path, prefix: str) -> str:
        """Compile and run `PREFIX_test.c`."""
        return c_family.self_test(folder, LANGUAGE, prefix, [f"{prefix}.c"])


def _values(subject: Subject, prefix: str) -> dict[str, str]:
    upper = prefix.upper()
    return {
        "p": prefix,
        "PREFIX": upper,
        "header": f"{prefix}.c",
        "function": "static",
        "size_t": "size_t",
        "sensors": f"{upper}_SENSORS",
        "actuators": f"{upper}_ACTUATORS",
        "self": "controller->",
        "data": f"{prefix}_",
        "detail": "",
        "reset_signature": f"void {prefix}_reset({prefix}_t *controller)",
        "step_signature": f"bool {prefix}_step({prefix}_t *controller, const float *sensors, float *actuators)",  # noqa: E501 - C
        "facts": format_facts(subject),
    }


def format_loadable_source(subject: Subject, prefix: str) -> Files:
    """Return `PREFIX.c` and `PREFIX.h` without weights, which `PREFIX_load(path)` reads from a file.

    Controllers that differ in their weights only share the source, so that it is compiled once. The file is
    written by `format_weights`. Raises InputError for unsupported kinds of controllers.
    """
    values = {**_values(subject, prefix), "loaded": "yes"}
    return {
        f"{prefix}.h": _header(subject, values, loaded=True),
        f"{prefix}.c": _source(subject, values, loaded=True),
    }


def format_weights(subject: Subject) -> str:
    """Return the content of the file for `PREFIX_load`, see `format_loadable_source`.

    A line of eight hexadecimal digits for each number: first the count, then the bits of binary32 numbers, or
    integers.
    """
    evolved = [table.evolved for table in generate_code(subject, _values(subject, "controller")).tables]
    bits = [array.view(np.uint32) for array in evolved if array is not None]
    numbers = np.concatenate(bits).tolist()
    return "".join(f"{number:08x}\n" for number in [len(numbers), *numbers])


_ROBOT = """/* Another number on each robot: robots with the same random numbers act alike. */
#define ROBOT_ID 0"""
_SEED = """    /* The least bits of a pin with nothing connected are noise; boards may read alike. */
    unsigned long seed = 2166136261UL;
    for (int bit = 0; bit < 256; bit++) {
        seed = ((seed ^ (unsigned long)(analogRead(A0) & 3)) * 16777619UL) & 0xFFFFFFFFUL;
    }
    seed = ((seed ^ (unsigned long)ROBOT_ID) * 16777619UL) & 0x7FFFFFFFUL;
    randomSeed(seed > 0 ? seed : 1);"""
_LOAD = """/*
 * Reads the numbers of the controller from a file that Swarmwright has written; call it before the first
 * step. Returns false when the file cannot be read, or is that of another controller's source.
 */
bool {p}_load(const char *path);"""


def _header(subject: Subject, values: dict[str, str], *, loaded: bool = False) -> str:
    generated = generate_code(subject, values)
    upper = values["PREFIX"]
    return render(
        "c_header.txt",
        {
            **values,
            "sensors": str(len(subject.sensors)),
            "actuators": str(len(subject.actuators)),
            "conversion": c_family.conversion(subject),
            "sensor_enum": c_family.enumeration(subject.sensors, f"{upper}_SENSOR_", "SENSOR"),
            "actuator_enum": c_family.enumeration(subject.actuators, f"{upper}_ACTUATOR_", "ACTUATOR"),
            "step_seconds": c_family.step_seconds(subject, f"#define {upper}_STEP_SECONDS"),
            "refusals": c_family.refusals(generated),
            "state": generated.state,
            "state_words": generated.state_words,
            "load": _LOAD.format(p=values["p"]) if loaded else "",
        },
    )


def _source(subject: Subject, values: dict[str, str], *, loaded: bool = False) -> str:
    generated = generate_code(subject, values)
    flash = f"{values['PREFIX']}_FLASH"
    tables = [
        f"static {table.type} {values['p']}_{table.name}[{table.length}];"
        if loaded and table.evolved is not None
        else c_family.define_table(table, f"static const {table.type} {values['p']}_", flash)
        for table in generated.tables
    ]
    return render(
        "c_source.txt",
        {
            **values,
            "header_source": f"{values['p']}.c: an evolved controller, see {values['p']}.h.",
            **c_family.common(generated, values),
            "tables": "\n\n".join(tables),
            "load_headers": "#include <stdio.h>\n#include <string.h>" if loaded else "",
            "load": _load(generated.tables, values).rstrip() if loaded else "",
        },
    )


def _load(tables: tuple[Table, ...], values: dict[str, str]) -> str:
    evolved = [table for table in tables if table.evolved is not None]
    reads = []
    for parameter in evolved:
        name = f"{values['p']}_{parameter.name}"
        reads += [
            f"    for (i = 0; i < {parameter.length}; i++) {{",
            f"        if (!{values['p']}_number(file, &number)) {{",
            "            return false;",
            "        }",
            f"        memcpy(&{name}[i], &number, sizeof number);"
            if parameter.type == "float"
            else f"        {name}[i] = ({parameter.type})number;",
            "    }",
        ]
    count = str(sum(parameter.length for parameter in evolved))
    return render("c_load.txt", {**values, "count": count, "reads": "\n".join(reads)})


def _sketch(subject: Subject, values: dict[str, str], sketch: str) -> str:
    upper = values["PREFIX"]
    read = c_family.assignments(subject.sensors, f"{upper}_SENSOR_", "SENSOR", "sensors")
    drive = c_family.uses(subject.actuators, f"{upper}_ACTUATOR_", "ACTUATOR")
    step = subject.step_size
    period_words = "a step of the simulation" if step else "a guess, for the duration of a step is not known"
    draws = any(sensor.name == RANDOM and sensor.range is None for sensor in subject.sensors)
    text = render(
        "arduino.txt",
        {
            **values,
            "facts": format_facts(
                subject, advice=f"once you have edited it, exports write {sketch}.ino.new beside it"
            ),
            "sketch": sketch,
            "period": str(round(1e6 * step) if step else 100_000),
            "period_words": period_words,
            "robot": _ROBOT if draws else "",
            "seed": _SEED if draws else "",
            "read": read,
            "drive": drive,
            "stop": c_family.stops(subject.actuators, f"{upper}_ACTUATOR_", "ACTUATOR"),
        },
    )
    return seal(text)
