"""Controllers in C and C++ for other processors: `make test-export` installs compilers and emulators.

arm64 and armhf run under qemu, where compilers fuse multiplications and additions by default; an ATmega328P,
the processor of an Arduino Uno, under simavr.
"""

import dataclasses
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from swarmwright.common.errors import RunError
from swarmwright.controllers.source.text import literals
from swarmwright.export.c import C
from swarmwright.export.cpp import Cpp
from swarmwright.export.exporting import write
from swarmwright.export.programs import format_steps, parse_actuators, run
from swarmwright.export.sequences import draw_random_sequences, measure_difference
from tests.python.export.specifications import ALL, few, network, sequences_of, subject
from tests.python.export.test_c import STRICT, together

ARM64 = ("aarch64-linux-gnu-gcc", "qemu-aarch64", "/usr/aarch64-linux-gnu")
ARMHF = ("arm-linux-gnueabihf-gcc", "qemu-arm", "/usr/arm-linux-gnueabihf")
AVR = ["avr-gcc", "-mmcu=atmega328p", "-Os", "-std=gnu99", "-Wno-missing-braces"]
KINDS = ["layered-tanh-0", "layered-sigmoid-4", "fully_meshed-clamp-0", "fully_meshed-sigmoid-3", "mealy_fsm"]


def need(*programs: str) -> None:
    """Skip without programs, but where they were installed for this."""
    missing = [name for name in programs if not shutil.which(name)]
    if missing and "SWARMWRIGHT_TEST_EXPORT" not in os.environ:
        pytest.skip(f"{', '.join(missing)}: not installed; make test-export installs it")
    assert not missing


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("target", "options"),
    [
        (ARM64, ["-O3"]),
        (ARM64, ["-O2", "-std=c99", "-ffp-contract=fast"]),
        (ARMHF, ["-O3", "-mfpu=vfpv4"]),
        (ARMHF, ["-O3", "-mfpu=neon-vfpv4", "-marm"]),
        (ARMHF, ["-O2"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value[0].partition("-")[0],
)
def test_arm(target: tuple[str, str, str], options: list[str], tmp_path: Path) -> None:
    compiler, emulator, root = target
    need(compiler, emulator)
    names = list(ALL)
    (tmp_path / "main.c").write_text(together(names, tmp_path))
    sources = ["main.c", *(f"c{index}.c" for index in range(len(names)))]
    run([compiler, *options, *sources, "-o", "all"], tmp_path, compiler)
    for index, name in enumerate(names):
        sequences = sequences_of(name)
        words = [emulator, "-L", root, "./all", str(index)]
        written = parse_actuators(run(words, tmp_path, name, format_steps(sequences)), sequences, name)
        assert measure_difference(sequences, written) == (0.0, 0), name


@pytest.mark.slow
@pytest.mark.parametrize("target", [ARM64, ARMHF], ids=["arm64", "armhf"])
def test_arm_fuses_without_protection(target: tuple[str, str, str], tmp_path: Path) -> None:
    """What `volatile` is for: without it, these compilers fuse, and the comparison notices."""
    compiler, emulator, root = target
    need(compiler, emulator)
    specification = network("layered", "tanh", [-1.0, 1.0], sensors=8)
    sequences = few(specification)
    write(C().files(subject(specification), "robot"), tmp_path)
    source = tmp_path / "robot.c"
    source.write_text(source.read_text().replace("typedef volatile float", "typedef float"))
    main = (tmp_path / "robot_test.c").read_text()
    (tmp_path / "robot_test.c").write_text(main.replace("return 1;", "return 0;"))
    float_unit = ["-mfpu=vfpv4"] if target is ARMHF else []
    run([compiler, "-O2", *float_unit, "robot.c", "robot_test.c", "-o", "robot"], tmp_path, compiler)
    said = run([emulator, "-L", root, "./robot"], tmp_path, emulator)
    assert len(sequences)
    assert b"the actuators differ from those of the simulation" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layered-tanh-2", "fully_meshed-sigmoid-5", "hebbian", "neat", "modules"])
@pytest.mark.parametrize("options", [["-O2", *STRICT], ["-O3", "-funsafe-math-optimizations"]])
def test_clang_for_arm_may_be_told_to_reorder(options: list[str], name: str, tmp_path: Path) -> None:
    """It has no float_control there; other pragmas switch off what changes results, without warnings."""
    compiler, emulator, _ = ARM64
    need(compiler, emulator, "clang")
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    words = ["clang", "--target=aarch64-linux-gnu", "-c"]
    run([*words, *options, "robot.c"], tmp_path, "clang")
    run([*words, "robot_test.c"], tmp_path, "clang")
    run([compiler, "-static", "robot.o", "robot_test.o", "-o", "robot"], tmp_path, compiler)
    assert run([emulator, "./robot"], tmp_path, name) == b"ok\n"


@pytest.mark.slow
@pytest.mark.parametrize("target", [ARM64, ARMHF], ids=["arm64", "armhf"])
def test_arm_in_cpp(target: tuple[str, str, str], tmp_path: Path) -> None:
    compiler, emulator, root = target
    compiler = compiler.replace("-gcc", "-g++")
    need(compiler, emulator)
    for name in KINDS:
        write(Cpp().files(subject(ALL[name]), "robot"), tmp_path)
        run([compiler, "-O3", *STRICT, "robot_test.cpp", "-o", "robot"], tmp_path, compiler)
        assert run([emulator, "-L", root, "./robot"], tmp_path, name) == b"ok\n"


SMALL = [
    name for name in ALL if len(ALL[name]["weights"]) < 7000 and ALL[name]["kind"] not in {"hebbian", "neat"}
]
"""What a Hebbian network learns, and NEAT's, is computed with a double of 64 bits, which AVR lacks."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_avr_compiles_with_all_warnings_as_errors(name: str, tmp_path: Path) -> None:
    need("avr-gcc")
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    run(["avr-gcc", "-mmcu=atmega328p", "-Os", "-std=c99", *STRICT, "-c", "robot.c"], tmp_path, name)
    # Tables are in flash, which counts as text; nothing is in memory but the struct.
    sizes = run(["avr-size", "robot.o"], tmp_path, name).split(b"\n")[1].split()
    assert sizes[1:3] == [b"0", b"0"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["evostick", "mealy_fsm", "layered-wide"])
def test_the_self_test_fits_on_avr(name: str, tmp_path: Path) -> None:
    """Its tables are in flash, cut after 20 steps; they do not fill the 2 kB of memory."""
    need("avr-gcc")
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    run([*AVR, *STRICT, "robot.c", "robot_test.c", "-o", "test.elf"], tmp_path, name)
    _, data, bss = (
        int(one) for one in run(["avr-size", "test.elf"], tmp_path, name).split(b"\n")[1].split()[:3]
    )
    assert data + bss < 1500


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hebbian", "neat"])
def test_avr_is_refused_by_what_needs_doubles_of_64_bits(name: str, tmp_path: Path) -> None:
    need("avr-gcc")
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    with pytest.raises(RunError, match="computed with a double of 64 bits"):
        run(["avr-gcc", "-mmcu=atmega328p", "-Os", "-std=c99", "-c", "robot.c"], tmp_path, name)


@pytest.mark.slow
def test_the_sketch_compiles(tmp_path: Path) -> None:
    """As the Arduino IDE does it: as C++, with Arduino.h included, together with the C."""
    need("avr-g++")
    description = {"sensor_names": ["a", "b", "random"]}
    made = dataclasses.replace(subject(ALL["fully_meshed-clamp-0"]), description=description)
    write(C().files(made, "robot"), tmp_path)
    (tmp_path / "Arduino.h").write_text(
        "struct Port { void begin(unsigned long); void println(double, int); };\nextern Port Serial;\n"
        'extern "C" unsigned long micros(void);\nvoid setup();\nvoid loop();\n'
        "long random(long);\nvoid randomSeed(unsigned long);\nint analogRead(int);\nenum { A0 = 14 };\n"
    )
    words = ["avr-g++", "-mmcu=atmega328p", "-Os", "-Wall", "-Wextra", "-Werror", "-include", "../Arduino.h"]
    folder = tmp_path / "robot_arduino"
    run([*words, "-x", "c++", "-c", "robot_arduino.ino"], folder, "avr-g++")
    run(["avr-gcc", "-mmcu=atmega328p", "-Os", "-c", "robot.c"], folder, "avr-gcc")


MAIN = """
#include "robot.h"
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include <string.h>
@tables@
static robot_t robot;
static void say(const char *text)
{
    while (*text) {
        while (!(UCSR0A & (1 << UDRE0))) {
        }
        UCSR0A |= 1 << TXC0;
        UDR0 = (uint8_t)*text++;
    }
    while (!(UCSR0A & (1 << TXC0))) {
    }
}
int main(void)
{
    uint16_t step, index;
    uint16_t wrong = 0;
    UCSR0B = 1 << TXEN0;
    for (step = 0; step < STEPS; step++) {
        float sensors[ROBOT_SENSORS], actuators[ROBOT_ACTUATORS];
        for (index = 0; index < ROBOT_SENSORS; index++) {
            sensors[index] = pgm_read_float(&in[step][index]);
        }
        if (pgm_read_byte(&first[step])) {
            robot_reset(&robot);
        }
        if (!robot_step(&robot, sensors, actuators)) {
            wrong++;
        }
        for (index = 0; index < ROBOT_ACTUATORS; index++) {
            uint32_t bits;
            memcpy(&bits, &actuators[index], 4);
            if (bits != pgm_read_dword(&out[step][index])) {
                wrong++;
            }
        }
    }
    say(wrong ? "different\\n" : "same bits\\n");
    cli();
    sleep_mode();
    return 0;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_avr_has_the_same_bits(name: str, tmp_path: Path) -> None:
    """On an emulated ATmega328P, whose floats are computed by avr-libc: ordinary and subnormal numbers."""
    need("avr-gcc", "simavr")
    sequences = draw_random_sequences(ALL[name], 30, refused=False)
    write(C().files(subject(ALL[name]), "robot"), tmp_path)
    columns = {
        "uint8_t first[STEPS]": sequences.first.astype(int).astype(str),
        "float in[STEPS][ROBOT_SENSORS]": np.array(literals(sequences.sensors.reshape(-1))),
        "uint32_t out[STEPS][ROBOT_ACTUATORS]": np.char.mod(
            "%du", sequences.actuators.view(np.uint32)
        ).reshape(-1),
    }
    tables = [f"#define STEPS {len(sequences)}"] + [
        f"static const {begin} PROGMEM = {{{', '.join(values)}}};" for begin, values in columns.items()
    ]
    (tmp_path / "main.c").write_text(MAIN.replace("@tables@", "\n".join(tables)))
    run([*AVR, "robot.c", "main.c", "-o", "robot.elf"], tmp_path, "avr-gcc")
    said = run(["sh", "-c", "simavr -m atmega328p -f 16000000 robot.elf 2>&1"], tmp_path, "simavr")
    assert b"same bits" in said, said
