"""Controllers as files: JSON, and source code that is compiled once."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, RunError, evaluate, optimize
from tests.python.records import same_record

LOOP = """
x, v = 1.0 + int(sys.argv[-2]) / 4, 0.0
for _ in range(20):
    v += 0.125 * float(control([x, v])[0])
    x += 0.125 * v
open(sys.argv[-1], "w").write(f"fitness\\n{-abs(x)!r}\\n")
"""
JSON = "import sys\nfrom swarmwright import Controller\ncontrol = Controller.load(sys.argv[1])\n" + LOOP
PYTHON = (
    """
import sys
sys.path.insert(0, ".")
from controller import Controller
one = Controller()
def control(sensors):
    return one.step(sensors)
"""
    + LOOP
)
ONNX = (
    """
import sys
import numpy as np
import onnxruntime
session = onnxruntime.InferenceSession(sys.argv[1])
def control(sensors):
    return session.run(["actuators"], {"sensors": np.array([sensors], np.float32)})[0][0]
"""
    + LOOP
)
C = """
#include "controller.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **words)
{
    controller_t controller;
    double x = 1.0 + atoi(words[1]) / 4.0, v = 0.0;
    float sensors[2], actuators[1];
    controller_reset(&controller);
    for (int step = 0; step < 20; step++) {
        sensors[0] = (float)x;
        sensors[1] = (float)v;
        controller_step(&controller, sensors, actuators);
        v += 0.125 * actuators[0];
        x += 0.125 * v;
    }
    FILE *log = fopen(words[2], "w");
    fprintf(log, "fitness\\n%.17g\\n", -fabs(x));
    return count < 0;
}
"""


def experiment(folder: Path, command: Any, **definition: Any) -> Experiment:
    simulation = {
        "command": command,
        "folder": str(folder),
        "work": str(folder / "work"),
        "log": "log.csv",
        "sensors": 2,
        "actuators": 1,
        **definition,
    }
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "controller": {"kind": "layered", "hidden": [2]},
            "method": {"population": 4, "generations": 1},
            "ranking": {"episodes": 2},
        }
    )


def expected(one: Experiment, genomes: Any) -> list[float]:
    found = []
    for genome in np.asarray(genomes, np.float32):
        specification = {**one.representation().architecture(), "weights": genome.tolist()}
        total = 0.0
        for seed in (0, 1):
            controller, x, v = Controller(specification), 1.0 + seed / 4, 0.0
            for _ in range(20):
                v += 0.125 * float(controller([np.float32(x), np.float32(v)])[0])
                x += 0.125 * v
            total -= abs(x)
        found.append(total / 2)
    return found


def genomes_of(one: Experiment, count: int) -> Any:
    return np.random.default_rng(3).normal(size=(count, one.genome_size)).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize(("form", "text"), [("json", JSON), ("python", PYTHON)])
def test_read_by_a_script(tmp_path: Path, form: str, text: str) -> None:
    (tmp_path / "sim.py").write_text(text)
    one = experiment(tmp_path, [sys.executable, "sim.py", "{controller}", "{seed}", "{log}"], controller=form)
    genomes = genomes_of(one, 2)
    assert evaluate(one, genomes, servers=1).tolist() == expected(one, genomes)


@pytest.mark.slow
def test_read_by_a_runtime_for_models(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    (tmp_path / "sim.py").write_text(ONNX)
    one = experiment(
        tmp_path, [sys.executable, "sim.py", "{controller}", "{seed}", "{log}"], controller="onnx"
    )
    genomes = genomes_of(one, 1)
    found = evaluate(one, genomes, servers="in-process").tolist()
    assert found == pytest.approx(expected(one, genomes), abs=1e-4)


COMPILER = '#!/bin/sh\necho compiled >> {here}/compilations\nexec cc "$@"\n'


@pytest.mark.slow
def test_compiled_once_for_a_candidate(tmp_path: Path) -> None:
    (tmp_path / "sim.c").write_text(C)
    compiler = tmp_path / "compiler"
    compiler.write_text(COMPILER.replace("{here}", str(tmp_path)))
    compiler.chmod(0o755)
    one = experiment(
        tmp_path,
        ["{build}/sim", "{seed}", "{log}"],
        controller="c",
        compile="./compiler -O1 -I{build} sim.c {controller} -lm -o {build}/sim",
    )
    genomes = genomes_of(one, 3)
    assert evaluate(one, genomes, servers="in-process").tolist() == expected(one, genomes)
    assert (tmp_path / "compilations").read_text().count("compiled") == 3
    runs = [optimize(one, out=tmp_path / str(servers), servers=servers) for servers in (2, "in-process")]
    same_record(*runs)
    # Also by other servers: the second run finds what the first has compiled.
    assert (tmp_path / "compilations").read_text().count("compiled") == 3 + 4


LOADED = C.replace(
    "    controller_reset(",
    '    if (!controller_load(words[3])) { fputs("no weights", stderr); return 4; }\n    controller_reset(',
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "controller",
    [
        {"kind": "layered", "hidden": [2]},
        {"kind": "fully_meshed", "hidden": 2},
        {"kind": "mealy_fsm", "states": 3},
    ],
    ids=lambda value: str(value["kind"]),
)
def test_compiled_once_for_an_experiment(tmp_path: Path, controller: dict[str, Any]) -> None:
    """Weights in a file: one compilation for all candidates, with the fitness of the compiled ones."""
    (tmp_path / "sim.c").write_text(C)
    (tmp_path / "loaded.c").write_text(LOADED)
    compiler = tmp_path / "compiler"
    compiler.write_text(COMPILER.replace("{here}", str(tmp_path)))
    compiler.chmod(0o755)
    build = "-O1 -I{build} {controller} -lm -o {build}/sim"
    compiled, loaded = (
        experiment(tmp_path, command, controller="c", **definition).replace(controller=controller)
        for command, definition in (
            ("{build}/sim {seed} {log}", {"compile": f"cc sim.c {build}"}),
            (
                "{build}/sim {seed} {log} {weights}",
                {"compile": f"./compiler loaded.c {build}", "weights": "file"},
            ),
        )
    )
    of_each = optimize(compiled, out=tmp_path / "compiled", servers="in-process")
    one = optimize(loaded, out=tmp_path / "loaded", servers="in-process")
    same_record(optimize(loaded, out=tmp_path / "two", servers=2), one)
    assert one.history == of_each.history
    assert (tmp_path / "compilations").read_text().count("compiled") == 1


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        ({"controller": "json", "compile": "cc", "weights": "file"}, r"weights: file needs controller: c"),
        ({"controller": "c", "weights": "file"}, r"weights: file needs controller: c and compile"),
        ({"controller": "c", "compile": "cc {weights}", "weights": "file"}, r"compile: \{weights\} differs"),
        ({"controller": "c", "compile": "cc", "command": "x {weights}"}, r"\{weights\} needs weights: file"),
    ],
)
def test_weights_in_a_file_need_a_compiler(tmp_path: Path, definition: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        experiment(tmp_path, definition.pop("command", "x"), **definition)


@pytest.mark.slow
def test_what_does_not_compile_is_a_failed_evaluation(tmp_path: Path) -> None:
    one = experiment(
        tmp_path,
        ["{build}/sim"],
        controller="json",
        compile=["sh", "-c", "echo 'sim.c:3: no such part' >&2; exit 4"],
    )
    with pytest.raises(
        RunError, match=r"compile: ended with exit status 4; its last output: sim\.c:3: no such"
    ):
        optimize(one, out=tmp_path / "run", servers="in-process")


def test_compile_needs_a_controller(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"simulation\.compile: needs a controller: json, c, cpp, python or onnx"
    ):
        experiment(tmp_path, "x", compile="cc")
    with pytest.raises(InputError, match=r"\{build\} needs compile"):
        experiment(tmp_path, "{build}/x", controller="c")


def test_a_controller_stays_here_in_other_modes(tmp_path: Path) -> None:
    one = experiment(tmp_path, "x", controller="json")
    for mode in ("stepwise", "batched"):
        with pytest.raises(InputError, match=f"mode: {mode} keeps controllers in this process"):
            one.replace(mode=mode)
