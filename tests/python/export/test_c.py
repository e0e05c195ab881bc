"""Controllers in C and C++: the bits of the engine, whatever the compiler does."""

import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from swarmwright.common.errors import InputError, RunError
from swarmwright.controllers.source.text import c_literal, check_type, plain
from swarmwright.export import EXPORTERS, Exporter, c_family
from swarmwright.export._base import render
from swarmwright.export.c import LANGUAGE, C, format_loadable_source, format_weights
from swarmwright.export.cpp import Cpp
from swarmwright.export.exporting import write
from swarmwright.export.programs import format_steps, parse_actuators, run
from swarmwright.export.sequences import measure_difference
from tests.python.export.specifications import (
    ALL,
    NASTY,
    Specification,
    few,
    nasty,
    network,
    networks,
    sequences_of,
    subject,
)

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow", "-Wfloat-equal", "-Wundef"]
STRICT += ["-Wunused-macros"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
OLD_GCC = [name for name in ("gcc-9", "gcc-10", "gcc-11") if shutil.which(name)]


def bits(exporter: Exporter, specification: Specification, folder: Path) -> tuple[float, int]:
    """The largest difference and how many actuators differ, in a hundred sequences."""
    made = subject(specification)
    write(exporter.files(made, "robot"), folder)
    sequences = few(specification)
    return measure_difference(sequences, exporter.run(folder, "robot", sequences))


def together(names: list[str], folder: Path) -> str:
    """Source of a program that holds many controllers, and steps each through the sequences that it reads."""
    cases = []
    for index, name in enumerate(names):
        write(C().files(subject(ALL[name]), f"c{index}"), folder)
        cases.append(
            f"static int run_{index}(void) {{ static c{index}_t c; static float in[1 + C{index}_SENSORS];"
            f" static float out[1 + C{index}_ACTUATORS]; size_t a; c{index}_reset(&c);"
            f" while (fread(in, sizeof in, 1, stdin) == 1) {{ if (in[0] > 0.0f) {{ c{index}_reset(&c); }}"
            f" for (a = 0; a < C{index}_ACTUATORS; a++) {{ out[1 + a] = 7.0f; }}"
            f" out[0] = c{index}_step(&c, in + 1, out + 1) ? 1.0f : 0.0f; "
            " fwrite(out, sizeof out, 1, stdout); }"
            " return 0; }"
        )
    includes = "\n".join(f'#include "c{index}.h"' for index in range(len(names)))
    choices = "".join(f"case {index}: return run_{index}(); " for index in range(len(names)))
    main = (
        f"int main(int n, char **v) {{ switch (n > 1 ? atoi(v[1]) : 0) {{ {choices} default: return 9; }} }}"
    )
    return f"#include <stdio.h>\n#include <stdlib.h>\n{includes}\n" + "\n".join([*cases, main]) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compiler", "options"),
    [
        ("gcc", ["-O1", "-std=c99", *STRICT]),
        ("gcc", ["-O3", "-ffp-contract=off", "-march=native", "-DSWARMWRIGHT_CONTRACT_OFF"]),
        ("gcc", ["-O3", "-march=native", "-ffp-contract=fast"]),
        ("gcc", ["-O2", "-mfpmath=387"]),
        ("gcc", ["-O2", "-mfpmath=387", "-std=c99"]),
        ("clang", ["-O0", "-std=c99", *STRICT, "-DSWARMWRIGHT_CONTRACT_OFF"]),
        ("clang", ["-O3", "-march=native", "-ffp-contract=fast"]),
        ("clang", ["-O3", "-march=native", "-ffp-contract=off", "-DSWARMWRIGHT_CONTRACT_OFF"]),
        # It defines no macro for these, by which they could be refused.
        ("clang", ["-funsafe-math-optimizations", "-O3", "-march=native"]),
        ("clang", ["-freciprocal-math", "-O3"]),
        ("clang", ["-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-O3"]),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value[:2]),
)
def test_every_kind_in_one_program(compiler: str, options: list[str], tmp_path: Path) -> None:
    """Many controllers side by side have the engine's bits, with warnings as errors and without."""
    if compiler not in COMPILERS:
        pytest.skip(f"{compiler} is not installed")
    # What a network learns, and all of NEAT's, has 64 bits, which x87 does not compute with.
    names = [
        name for name in ALL if "-mfpmath=387" not in options or not name.startswith(("hebbian", "neat"))
    ]
    (tmp_path / "main.c").write_text(together(names, tmp_path))
    sources = ["main.c", *(f"c{index}.c" for index in range(len(names)))]
    run([compiler, *options, "-c", *sources], tmp_path, compiler)
    # Linked without options: with -funsafe-math-optimizations the program would flush subnormal numbers.
    objects = [source.replace(".c", ".o") for source in sources]
    run([compiler, *objects, "-o", "all"], tmp_path, compiler)
    for index, name in enumerate(names):
        sequences = sequences_of(name)
        written = parse_actuators(
            run(["./all", str(index)], tmp_path, name, format_steps(sequences)), sequences, name
        )
        assert measure_difference(sequences, written) == (0.0, 0), name


@pytest.mark.parametrize("exporter", [C(), Cpp()], ids=["c", "cpp"])
@pytest.mark.parametrize("name", ALL)
def test_decimals_in_expressions_are_exact(name: str, exporter: Exporter) -> None:
    """Compilers for x87 may read others with more than 32 bits; as values of constants they are rounded."""
    for file, content in exporter.files(subject(ALL[name]), "robot").items():
        if file not in ("robot.c", "robot.hpp"):
            continue
        text = re.sub(r"/\*.*?\*/", "", str(content), flags=re.DOTALL)
        text = re.sub(r"= \{[^;]*\};", "", text)
        text = re.sub(r"\bfloat \w+ = -?[\d.e+-]+f;", "", text)
        for literal in re.findall(r"\b(\d+\.\d*(?:e[+-]?\d+)?)f\b", text):
            assert Fraction(literal) == Fraction(float(np.float32(literal))), f"{file}: {literal}f"


@pytest.mark.slow
def test_a_prefix_makes_no_type_of_the_c_library(tmp_path: Path) -> None:
    headers = ("fenv", "math", "pthread", "signal", "stdbool", "stdint", "stdio", "stdlib", "string", "time")
    source = "".join(
        f"#include <{header}.h>\n" for header in (*headers, "termios", "uchar", "unistd", "wctype")
    )
    (tmp_path / "headers.c").write_text(source)
    text = run(["gcc", "-std=c11", "-D_POSIX_C_SOURCE=200809L", "-E", "-P", "headers.c"], tmp_path, "gcc")
    found = set(re.findall(r"\b([A-Za-z]\w*)_t\b", text.decode()))
    assert {"size", "off", "int_least8"} <= found
    for prefix in sorted(found):
        with pytest.raises(InputError, match=f"prefix: {prefix}_t is a type of C or POSIX"):
            check_type(prefix)


@pytest.mark.slow
def test_the_standard_that_a_compiler_is_named_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "strict.c").write_text(
        "#ifdef __STRICT_ANSI__\nint main(void) { return 0; }\n#else\n#error GNU mode\n#endif\n"
    )
    monkeypatch.setenv("CC", "gcc -std=c99")
    assert LANGUAGE.compile(tmp_path, ["strict.c"], "strict", ["-O2"])
    monkeypatch.setenv("CC", "gcc")
    with pytest.raises(RunError, match="GNU mode"):
        LANGUAGE.compile(tmp_path, ["strict.c"], "strict", ["-O2"])


@pytest.mark.slow
@pytest.mark.parametrize("exporter", [C(), Cpp()], ids=["c", "cpp"])
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(specification=networks())
def test_any_network(exporter: Exporter, specification: Specification, tmp_path: Path) -> None:
    assert bits(exporter, specification, tmp_path) == (0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "layered-sigmoid-5",
        "fully_meshed-tanh-8",
        "mealy_fsm",
        "mealy_fsm-blind",
        "layered-direct",
        "modules",
        "modules-tree",
        "evostick",
        "hebbian",
        "neat",
        "neat-deaf",
    ],
)
def test_every_kind_in_cpp(name: str, tmp_path: Path) -> None:
    made = subject(ALL[name])
    write(Cpp().files(made, "robot"), tmp_path)
    for compiler in ["g++", *(["clang++"] if "clang" in COMPILERS else [])]:
        options = [*STRICT, "-Wold-style-cast", "-std=c++11", "-fno-exceptions", "-fno-rtti"]
        options += ["-Wuseless-cast"] if compiler == "g++" else []
        run([compiler, *options, "robot_test.cpp", "-o", "self_test"], tmp_path, name)
        assert run(["./self_test"], tmp_path, name) == b"ok\n"
    assert bits(Cpp(), ALL[name], tmp_path) == (0.0, 0)


LOADS = """
#include "robot.h"
#include <stdio.h>

static float in[1 + ROBOT_SENSORS];
static float out[1 + ROBOT_ACTUATORS];

int main(int count, char **words)
{
    robot_t robot;
    if (count < 2 || !robot_load(words[1])) {
        fputs("no weights\\n", stderr);
        return 3;
    }
    robot_reset(&robot);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        size_t actuator;
        if (in[0] > 0.0f) {
            robot_reset(&robot);
        }
        for (actuator = 1; actuator <= ROBOT_ACTUATORS; actuator++) {
            out[actuator] = 7.0f;
        }
        out[0] = robot_step(&robot, in + 1, out + 1) ? 1.0f : 0.0f;
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layered-tanh-2", "fully_meshed-sigmoid-4", "mealy_fsm", "layered-direct"])
def test_weights_in_a_file(name: str, tmp_path: Path) -> None:
    """One program runs every controller that differs in its weights only, with the engine's bits."""
    first = ALL[name]
    second = {**first, "weights": [-one for one in first["weights"]]}
    (tmp_path / "main.c").write_text(LOADS)
    write(format_loadable_source(subject(first), "robot"), tmp_path)
    assert format_loadable_source(subject(first), "robot") == format_loadable_source(subject(second), "robot")
    run(["gcc", "-std=c99", *STRICT, "-O2", "main.c", "robot.c", "-o", "robot"], tmp_path, "gcc")
    for number, specification in enumerate([first, second]):
        weights = tmp_path / f"{number}.weights"
        weights.write_text(format_weights(subject(specification)))
        sequences = few(specification)
        words = ["./robot", str(weights)]
        written = parse_actuators(run(words, tmp_path, name, format_steps(sequences)), sequences, name)
        assert measure_difference(sequences, written) == (0.0, 0)


@pytest.mark.slow
def test_a_file_with_other_weights_is_refused(tmp_path: Path) -> None:
    made = subject(ALL["layered-tanh-2"])
    (tmp_path / "main.c").write_text(LOADS)
    write(format_loadable_source(made, "robot"), tmp_path)
    run(["gcc", "-std=c99", *STRICT, "main.c", "robot.c", "-o", "robot"], tmp_path, "gcc")
    whole = format_weights(made)
    others = [
        "",
        whole[: len(whole) // 2],
        whole + "3f800000\n",
        "nothing",
        format_weights(subject(ALL["layered-deep"])),
        whole.replace("\n", "\nx", 3),
    ]
    for text in others:
        (tmp_path / "weights").write_text(text)
        with pytest.raises(RunError, match="no weights"):
            run(["./robot", "weights"], tmp_path, "robot")
    with pytest.raises(RunError, match="no weights"):
        run(["./robot", "missing"], tmp_path, "robot")


@pytest.mark.slow
def test_two_units_and_both_languages_in_one_program(tmp_path: Path) -> None:
    """Headers may be included anywhere, in C and in C++, and two controllers beside each other."""
    for prefix, name in (("left", "layered-tanh-0"), ("right", "fully_meshed-clamp-0")):
        write(C().files(subject(ALL[name]), prefix), tmp_path)
        write(Cpp().files(subject(ALL[name]), prefix), tmp_path)
    unit = '#include "left.h"\n#include "right.h"\n#include "left.hpp"\n#include "right.hpp"\n'
    (tmp_path / "other.cpp").write_text(
        f"{unit}int other(void); int other(void) {{ left::Controller c; (void)c; return 0; }}\n"
    )
    (tmp_path / "main.cpp").write_text(
        f"{unit}int other(void);\n"
        "int main() { left_t l; right_t r; right::Controller c; left_reset(&l); right_reset(&r);"
        " float s[3] = {0.25f, -0.5f, 0.75f}; float a[2]; float b[2];"
        " return other() + (right_step(&r, s, a) && c.step(s, b) && a[0] >= b[0] && a[0] <= b[0] ? 0 : 1);"
        " }\n"
    )
    for source in ("left", "right"):
        run(["gcc", "-c", f"{source}.c"], tmp_path, source)
    run(
        ["g++", "-std=c++11", *STRICT, "main.cpp", "other.cpp", "left.o", "right.o", "-o", "both"],
        tmp_path,
        "both",
    )
    run(["./both"], tmp_path, "both")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layered-tanh-0", "neat", "hebbian"])
def test_clang_may_be_told_to_reorder_a_class(name: str, tmp_path: Path) -> None:
    """Code behind the header is as the option says; the controller has the bits of the engine."""
    if "clang" not in COMPILERS:
        pytest.skip("clang is not installed")
    written = Cpp().files(subject(ALL[name]), "robot")
    write(written, tmp_path)
    harness = {"p": "robot", **c_family.harness_values("robot", (0, 0), "C++")}
    made = subject(ALL[name])
    harness |= {"sensors": str(len(made.sensors)), "actuators": str(len(made.actuators))}
    source = render("c_harness.txt", {**harness, "step": "controller.step(in + 1, out + 1)"})
    (tmp_path / "main.cpp").write_text(source)
    run(["clang++", "-funsafe-math-optimizations", "-O3", "-c", "main.cpp"], tmp_path, "clang++")
    run(["clang++", "main.o", "-o", "one"], tmp_path, "clang++")
    sequences = sequences_of(name)
    found = parse_actuators(run(["./one"], tmp_path, name, format_steps(sequences)), sequences, name)
    assert measure_difference(sequences, found) == (0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layered-tanh-0", "fully_meshed-sigmoid-5", "hebbian", "neat", "modules"])
@pytest.mark.parametrize("compiler", OLD_GCC or [pytest.param("gcc-11", marks=pytest.mark.skip)])
def test_old_gcc_may_be_told_to_reorder(compiler: str, name: str, tmp_path: Path) -> None:
    """Before version 12 it defines no macro for this, by which it could be refused."""
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    run([compiler, "-O3", "-funsafe-math-optimizations", "-c", "robot.c"], tmp_path, compiler)
    run([compiler, "robot.o", "robot_test.c", "-o", "self_test"], tmp_path, compiler)
    assert run(["./self_test"], tmp_path, name) == b"ok\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mealy_fsm", "layered-relu-6", "modules"])
@pytest.mark.parametrize("option", ["-fno-honor-nans", "-fno-honor-infinities"])
def test_sensors_are_refused_whatever_clang_assumes(name: str, option: str, tmp_path: Path) -> None:
    """The self-test tries them: NaN and infinity are noticed by their bits."""
    if "clang" not in COMPILERS:
        pytest.skip("clang is not installed")
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    run(["clang", option, "-O3", "robot.c", "robot_test.c", "-o", "self_test"], tmp_path, "clang")
    assert run(["./self_test"], tmp_path, name) == b"ok\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layered-tanh-0", "mealy_fsm", "neat"])
@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_options_that_change_results_are_refused(option: str, name: str, tmp_path: Path) -> None:
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    done = subprocess.run(
        ["gcc", option, "-c", "robot.c"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "robot.c: compile without -f" in done.stderr


@pytest.mark.slow
def test_compilers_would_fuse_without_protection(tmp_path: Path) -> None:
    """The comparison notices a fused multiply-add: where `volatile` is left out, bits differ."""
    if " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor does not fuse")
    specification = network("layered", "tanh", [-1.0, 1.0], sensors=8)
    write(C().files(subject(specification), "robot"), tmp_path)
    source = tmp_path / "robot.c"
    source.write_text(source.read_text().replace("typedef volatile float", "typedef float"))
    sequences = few(specification)
    _, differing = measure_difference(sequences, C().run(tmp_path, "robot", sequences))
    assert differing > 0


@pytest.mark.slow
def test_memory_errors_and_undefined_behaviour(tmp_path: Path) -> None:
    """The self-tests of all kinds run clean with sanitizers, and one of each kind under valgrind."""
    names = [
        "layered-tanh-0",
        "layered-deep",
        "layered-direct",
        "fully_meshed-sigmoid-3",
        "hebbian",
        "neat",
        "mealy_fsm",
        "mealy_fsm-many",
    ]
    for name in names:
        write(C().files(subject(ALL[name]), "robot"), tmp_path)
        options = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
        run(["gcc", *options, "robot.c", "robot_test.c", "-o", "checked"], tmp_path, name)
        assert run(["./checked"], tmp_path, name) == b"ok\n"
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed")
    for name in ("layered-deep", "fully_meshed-sigmoid-3", "mealy_fsm"):
        write(C().files(subject(ALL[name]), "robot"), tmp_path)
        run(["gcc", "-O2", "-g", "robot.c", "robot_test.c", "-o", "plain"], tmp_path, name)
        words = ["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full", "./plain"]
        assert run(words, tmp_path, name) == b"ok\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hebbian", "neat"])
def test_what_has_64_bits_is_refused_where_doubles_are_others(name: str, tmp_path: Path) -> None:
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    command = ["gcc", "-std=c99", "-mfpmath=387", "-fsyntax-only", "robot.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "on x86 compile with -msse2 -mfpmath=sse" in done.stderr


@pytest.mark.slow
def test_a_wrong_table_is_noticed(tmp_path: Path) -> None:
    """Neither self-test nor comparison pass when a weight is off by one unit in the last place."""
    specification = ALL["fully_meshed-clamp-0"]
    write(C().files(subject(specification), "robot"), tmp_path)
    weight = np.float32(specification["weights"][1])
    source = tmp_path / "robot.c"
    text = source.read_text()
    assert text.count(f"{weight!s}f") == 1
    source.write_text(text.replace(f"{weight!s}f", f"{np.nextafter(weight, np.float32(9))!s}f"))
    sequences = few(specification)
    assert measure_difference(sequences, C().run(tmp_path, "robot", sequences))[1] > 0
    run(["gcc", "robot.c", "robot_test.c", "-o", "self_test"], tmp_path, "self-test")
    done = subprocess.run(["./self_test"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "differ from those of the simulation" in done.stdout


@pytest.mark.slow
def test_state_is_kept_and_forgotten(tmp_path: Path) -> None:
    """A controller that forgot its state, or kept it over a reset, would differ."""
    specification = ALL["fully_meshed-tanh-6"]
    source = "robot.c"
    write(C().files(subject(specification), "robot"), tmp_path)
    sequences = few(specification)
    whole = (tmp_path / source).read_text()
    forgetful = whole.replace("    int iteration;\n", "    int iteration;\n    robot_reset(controller);\n", 1)
    (tmp_path / source).write_text(forgetful)
    assert measure_difference(sequences, C().run(tmp_path, "robot", sequences))[1] > 0
    (tmp_path / source).write_text(whole.replace("controller->outputs[node] = 0.0f;", ";", 1))
    assert measure_difference(sequences, C().run(tmp_path, "robot", sequences))[1] > 0


@pytest.mark.slow
def test_every_form_is_deterministic() -> None:
    for form in EXPORTERS.names():
        exporter = EXPORTERS.get(form)()
        assert exporter.form == form
        known = {"machine": ["modules"], "scxml": ["mealy_fsm"]}
        for name in known.get(form, ["layered-tanh-0", "fully_meshed-clamp-0", "mealy_fsm"]):
            assert exporter.files(subject(ALL[name]), "robot") == exporter.files(subject(ALL[name]), "robot")


@pytest.mark.parametrize(
    ("step", "period", "words"),
    [(0.1, 100_000, "a step of the sim"), (1 / 30, 33_333, "a step of the sim"), (0.0, 100_000, "a guess")],
)
def test_the_sketch_has_the_duration_of_a_step(step: float, period: int, words: str) -> None:
    made = replace(subject(ALL["mealy_fsm"]), step_size=step)
    sketch = str(C().files(made, "robot")["robot_arduino/robot_arduino.ino"])
    assert f"period = {period};" in sketch
    assert words in sketch
    assert "random" not in sketch


def test_a_random_sensor_is_drawn_in_the_sketch_and_named_in_the_header() -> None:
    description = {"sensor_names": ["a", "b", "random"]}
    made = replace(subject(ALL["mealy_fsm"]), description=description)
    files = {name: str(content) for name, content in C().files(made, "robot").items()}
    sketch = files["robot_arduino/robot_arduino.ino"]
    assert "sensors[ROBOT_SENSOR_RANDOM] = (float)random(16777216L) / 16777216.0f;" in sketch
    assert "analogRead(A0)" in sketch
    assert "#define ROBOT_ID 0" in sketch
    assert "stop_actuators();" in sketch
    assert "random, a new random number from 0 to 1 in each step, another one on each" in files["robot.h"]


def test_the_sketch_stops_scaled_actuators_at_0() -> None:
    specification = network("layered", "tanh", [-1.0, 1.0], actuators=4)
    ranges = [(0, 100, "N"), (10, -30, "deg"), (5, 15, "m/s"), None]
    described = {"actuator_names": ["thrust", "rudder", "wind", "wheel"], "actuator_ranges": ranges}
    made = replace(subject(specification), description=described)
    sketch = str(C().files(made, "robot")["robot_arduino/robot_arduino.ino"])
    assert "FILL IN what is safe: called when a step was refused" in sketch
    assert "actuators[ROBOT_ACTUATOR_THRUST] = -1.0f; /* thrust: 0 N */" in sketch
    assert "actuators[ROBOT_ACTUATOR_RUDDER] = -0.5f; /* rudder: 0 deg */" in sketch
    assert "actuators[ROBOT_ACTUATOR_WIND] = -1.0f; /* wind: 5 m/s */" in sketch
    assert "actuators[ROBOT_ACTUATOR_WHEEL] = 0.0f; /* wheel */" in sketch


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 7, 20])
def test_a_self_test_takes_as_many_recorded_steps_as_is_said(steps: int, tmp_path: Path) -> None:
    write(C().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    words = [
        "gcc",
        "-std=c99",
        *STRICT,
        f"-DSELF_TEST_STEPS={steps}",
        "robot.c",
        "robot_test.c",
        "-o",
        "cut",
    ]
    run(words, tmp_path, "gcc")
    assert run(["./cut"], tmp_path, "self-test") == b"ok\n"


ONCE = """
#include "robot.h"
#include <float.h>
#include <stdio.h>
#include <string.h>

int main(void)
{
    robot_t robot;
    float sensors[ROBOT_SENSORS] = {0};
    float actuators[ROBOT_ACTUATORS] = {7};
    memset(&robot, @byte@, sizeof robot);
    printf("%d", robot_step(&robot, sensors, actuators));
    robot_reset(&robot);
    @change@
    printf("%d", robot_step(&robot, sensors, actuators));
    memset(sensors, 0, sizeof sensors);
    printf("%d", robot_step(&robot, sensors, actuators));
    robot_reset(&robot);
    printf("%d", robot_step(&robot, sensors, actuators));
    return 0;
}
"""


def once(specification: Specification, folder: Path, change: str = "", byte: int = 0) -> str:
    """Whether steps were accepted: without a reset, after a change, after that, and after another reset."""
    write(C().files(subject(specification), "robot"), folder)
    (folder / "once.c").write_text(ONCE.replace("@change@", change).replace("@byte@", str(byte)))
    options = ["-std=c99", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    run(["gcc", *options, "once.c", "robot.c", "-o", "once"], folder, "gcc")
    return run(["./once"], folder, "once").decode()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["layered-direct", "layered-deep", "fully_meshed-bare", "hebbian", "neat", "mealy_fsm", "modules"]
)
@pytest.mark.parametrize("byte", [0, 255])
def test_a_step_without_a_reset_is_refused(name: str, byte: int, tmp_path: Path) -> None:
    assert once(ALL[name], tmp_path, byte=byte) == "0111"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mealy_fsm", "modules"])
def test_a_state_outside_of_the_tables_is_refused(name: str, tmp_path: Path) -> None:
    assert once(ALL[name], tmp_path, "robot.state = 250;") == "0001"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fully_meshed-tanh-6", "hebbian"])
def test_an_overflow_is_refused_until_a_reset(name: str, tmp_path: Path) -> None:
    """In the engine all nodes are NaN from there on, and the actuators 0."""
    change = "sensors[0] = FLT_MAX; sensors[1] = FLT_MAX; sensors[2] = -FLT_MAX;"
    weights = ALL[name]["weights"]
    rows = weights[1:] if name == "hebbian" else weights
    assert any(rows)
    large = {**ALL[name], "weights": [*weights[: len(weights) - len(rows)], *(one * 100 for one in rows)]}
    assert once(large, tmp_path, change) == "0001"
    assert bits(C(), large, tmp_path / "bits") == (0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(("value", "accepted"), [(0, "1"), (1, "1"), (0.5, "1"), (-0.001, "0"), (12345, "0")])
def test_a_random_number_is_from_0_to_1(value: float, accepted: str, tmp_path: Path) -> None:
    assert once(ALL["modules"], tmp_path, f"sensors[8] = (float){value};") == f"0{accepted}11"


def test_trees_name_what_comes_next_as_figures_do() -> None:
    made = subject(ALL["modules-tree"])
    for text in (
        C().files(made, "robot")["robot.c"],
        EXPORTERS.get("python")().files(made, "robot")["robot.py"],
    ):
        assert "next subtree if" in str(text)


def test_only_c_speaks_of_a_missing_reset() -> None:
    assert "or there was no reset" in str(C().files(subject(ALL["mealy_fsm"]), "robot")["robot.h"])
    assert "no reset" not in str(Cpp().files(subject(ALL["mealy_fsm"]), "robot")["robot.hpp"])


def test_headers_have_the_duration_of_a_step() -> None:
    made = replace(subject(ALL["mealy_fsm"]), step_size=0.1)
    assert "#define ROBOT_STEP_SECONDS 0.1f" in str(C().files(made, "robot")["robot.h"])
    assert "Control cycle  0.1 s, a step of the simulation" in str(C().files(made, "robot")["robot.h"])
    assert "constexpr float step_seconds = 0.1f;" in str(Cpp().files(made, "robot")["robot.hpp"])
    assert "STEP_SECONDS" not in str(C().files(subject(ALL["mealy_fsm"]), "robot")["robot.h"])


@pytest.mark.parametrize("prefix", ["memcpy", "linux", "NULL", "uint8_t"])
def test_names_of_headers_and_macros_are_no_namespaces(prefix: str) -> None:
    with pytest.raises(InputError, match="is a name of the C library or a macro"):
        Cpp().files(subject(ALL["mealy_fsm"]), prefix)
    assert f"{prefix}.h" in C().files(subject(ALL["mealy_fsm"]), prefix)


@pytest.mark.slow
def test_a_compiler_for_another_processor_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its programs cannot be linked or run here; an emulator may run them."""
    compiler = tmp_path / "cross"
    compiler.write_text(
        '#!/bin/sh\ncase "$*" in\n*-dumpmachine*) echo arm-none-eabi ;;\n*) gcc "$@" ;;\nesac\n'
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    specification = ALL["mealy_fsm"]
    emulator = tmp_path / "emulator"
    emulator.write_text('#!/bin/sh\nexec "$@"\n')
    emulator.chmod(0o755)
    monkeypatch.setenv("CONTROLLER_RUN", str(emulator))
    assert bits(C(), specification, tmp_path / "emulated") == (0.0, 0)
    emulator.write_text("#!/bin/sh\necho no such board >&2; exit 126\n")
    with pytest.raises(RunError, match="no such board") as raised:
        bits(C(), specification, tmp_path / "failed")
    assert "another processor" not in str(raised.value)
    monkeypatch.delenv("CONTROLLER_RUN")
    compiler.write_text(compiler.read_text().replace('gcc "$@"', "echo no such option >&2; exit 1"))
    with pytest.raises(RunError, match=r"(?s)another processor \(arm-none-eabi\).*no such option"):
        bits(C(), specification, tmp_path / "refused")


@pytest.mark.slow
def test_cmake_builds_and_tests_all_of_a_folder(tmp_path: Path) -> None:
    if not shutil.which("cmake"):
        pytest.skip("cmake is not installed")
    for prefix, name in (("left", "layered-tanh-0"), ("right", "mealy_fsm"), ("test", "mealy_fsm-one")):
        write(C().files(subject(ALL[name]), prefix), tmp_path)
    write(Cpp().files(subject(ALL["mealy_fsm"]), "right"), tmp_path)
    native = ["-DCMAKE_C_FLAGS=-O3 -march=native", "-DCMAKE_CXX_FLAGS=-O3 -march=native"]
    run(["cmake", "-S", ".", "-B", "build", *native], tmp_path, "cmake")
    run(["cmake", "--build", "build"], tmp_path, "cmake")
    said = run(["ctest", "--test-dir", "build"], tmp_path, "ctest")
    assert b"100% tests passed, 0 tests failed out of 4" in said


@pytest.mark.slow
def test_names_cannot_leave_comments(tmp_path: Path) -> None:
    write({**C().files(nasty(), "robot"), **Cpp().files(nasty(), "robot")}, tmp_path)
    run(["gcc", "-std=c99", *STRICT, "robot.c", "robot_test.c", "-o", "c"], tmp_path, "C")
    run(["g++", "-std=c++11", *STRICT, "-Wold-style-cast", "robot_test.cpp", "-o", "cpp"], tmp_path, "C++")
    assert run(["./c"], tmp_path, "C") == run(["./cpp"], tmp_path, "C++") == b"ok\n"
    header = (tmp_path / "robot.h").read_text()
    assert header.isascii()
    assert "ROBOT_SENSOR_GOAL_X_4 = 4, /* goal x 4 in goal x" in header
    assert "ROBOT_SENSOR_GOAL_X_5 = 5 /*" in header


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\N{DEGREE SIGN}", "degrees"),
        ("\N{DEGREE SIGN}/s", "degrees/s"),
        ("5\N{DEGREE SIGN} or 5 \N{DEGREE SIGN}C", "5 degrees or 5 degrees C"),
        ("???/ ??/", "?? ?/ ? ?/"),
        ("gr\u00f6\u00dfe", "grosse"),
        ("*\\ x", "* / x"),
    ],
)
def test_texts_of_comments(text: str, shown: str) -> None:
    assert plain(text) == plain(plain(text)) == shown


def test_units_have_no_spaces_around_them() -> None:
    described = {"sensor_names": ["goal_x", "a", "b"], "sensor_units": ["\N{DEGREE SIGN}", "m", ""]}
    header = str(C().files(replace(subject(ALL["mealy_fsm"]), description=described), "robot")["robot.h"])
    assert "/* goal_x in degrees, any finite number */" in header


def test_what_a_sender_writes_cannot_leave_a_comment() -> None:
    """Facts of a bundle come from its sender; what is exported with them is compiled and run."""
    made = replace(
        subject(ALL["mealy_fsm"]), facts=(("Run", "*/ int x; /*"), ("*/ int y;", "\n*/ int z; /*"))
    )
    for name, text in {**C().files(made, "robot"), **Cpp().files(made, "robot")}.items():
        assert not re.search(r"\*/ int [xyz]", str(text)), name


@pytest.mark.slow
def test_literals_are_the_bytes_of_the_text(tmp_path: Path) -> None:
    texts = [*NASTY, "gr\u00f6\u00dfe1", "what??/??!??", "\U0001f600"]
    (tmp_path / "texts.c").write_text(
        "#include <stdio.h>\nint main(void)\n{\n"
        + "".join(f"    fputs({c_literal(one)}, stdout);\n" for one in texts)
        + "    return 0;\n}\n",
        encoding="ascii",
    )
    run(["gcc", "-std=c99", *STRICT, "texts.c", "-o", "texts"], tmp_path, "C")
    assert run(["./texts"], tmp_path, "C") == "".join(texts).encode()
