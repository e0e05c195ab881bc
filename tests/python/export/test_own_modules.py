"""Behaviours and conditions in Python: copied for Python, and in C where authors have given the same in C."""

import hashlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, RunError, optimize
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions
from swarmwright.export import Exporter
from swarmwright.export.c import C
from swarmwright.export.cpp import Cpp
from swarmwright.export.exporting import export_controller, write
from swarmwright.export.fmu import Fmu, Fmu3
from swarmwright.export.micropython import MicroPython
from swarmwright.export.onnx import Onnx
from swarmwright.export.programs import run
from swarmwright.export.python import Python
from swarmwright.export.ros import Ros1, Ros2
from swarmwright.export.sequences import draw_random_sequences, measure_difference
from tests.python.export.specifications import subject
from tests.python.export.test_c import COMPILERS, STRICT

CODE = '''"""Modules with code in C."""

import numpy as np
from swarmwright.controllers.modules import Behaviour, Condition, Parameter


class Weave(Behaviour):
    """Circles that widen; an obstacle makes the robot turn for a random time."""

    parameters = {"growth": Parameter(0.001, 0.1), "turn": Parameter(1, 30, integer=True)}
    state = 2
    c_code = """
        product drawn = random_unit(3) * turn;
        product growing;
        real below;
        real share;
        if (length(proximity_x, proximity_y) >= 0.1f && proximity_x > 0.0f && state[1] <= 0.0f) {
            state[1] = 1.0f + (float)(int)drawn;
        } else {
            state[1] = state[1] > 1.0f ? state[1] - 1.0f : 0.0f;
        }
        state[0] = state[1] > 0.0f ? 0.0f : state[0] + 1.0f;
        growing = growth * state[0];
        below = 1.0f + growing;
        share = 1.0f / below;
        left = state[1] > 0.0f ? -1.0f : 1.0f - share;
        right = 1.0f;
    """

    def act(self, senses, parameters, state, random):
        steps, turns = state[:, 0], state[:, 1]
        x, y = senses.proximity[:, 0], senses.proximity[:, 1]
        meets = (np.sqrt(x * x + y * y) >= np.float32(0.1)) & (x > 0) & (turns <= 0)
        longest = np.floor(random.unit(3) * parameters["turn"])
        turns[:] = np.where(meets, 1 + longest, np.maximum(turns - 1, 0))
        steps[:] = np.where(turns > 0, 0, steps + 1)
        inner = 1 - 1 / (1 + parameters["growth"] * steps)
        return np.stack([np.where(turns > 0, np.float32(-1), inner), np.ones_like(inner)], axis=1)


class Shy(Behaviour):
    """Away from others, faster than it can."""

    c_code = """
        product away = attraction_y * 3.0f;
        left = away;
        right = -attraction_x;
    """

    def act(self, senses, parameters, state, random):
        return np.stack([senses.attraction[:, 1] * 3, -senses.attraction[:, 0]], axis=1)


class Elapsed(Condition):
    """Some steps, and some more."""

    parameters = {"after": Parameter(1, 12, integer=True)}
    state = 1
    c_code = """
        state[0] = state[0] + 1.0f;
        probability = state[0] >= after + (float)random_integer(5, 1) ? 0.75f : 0.0f;
    """

    def probability(self, senses, parameters, state, random):
        state[:, 0] += 1
        later = parameters["after"] + random.integer(5, 1).astype(np.float32)
        return np.where(state[:, 0] >= later, np.float32(0.75), np.float32(0))


class Lit(Condition):
    """Light, or many others."""

    parameters = {"many": Parameter(0, 8)}
    c_code = "probability = root(light_x > 0.0f ? light_x : 0.0f) > 0.5f || neighbours > many ? 1.0f : 0.0f;"

    def probability(self, senses, parameters, state, random):
        bright = np.sqrt(np.maximum(senses.light[:, 0], 0)) > np.float32(0.5)
        return (bright | (senses.neighbours > parameters["many"])).astype(np.float32)
'''


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    found = tmp_path / "woven.py"
    found.write_text(CODE)
    return found


BEHAVIOURS = ["woven.py:Weave", "exploration", "woven.py:Shy", "attraction"]
CONDITIONS = ["neighbours", "woven.py:Elapsed", "woven.py:Lit", "fixed_probability"]


def controller(seed: int, **options: Any) -> dict[str, Any]:
    given = ModulesOptions(**{"behaviours": BEHAVIOURS, "conditions": CONDITIONS, **options})
    made = Modules(given, sensors=9, actuators=2)
    return made.specification(made.initial(Stream(seed, "machine")))


EXPORTERS = [C(), Cpp(), Python(), Ros1(), Ros2(), Fmu(), Fmu3()]


@pytest.mark.slow
@pytest.mark.parametrize("exporter", EXPORTERS, ids=lambda exporter: exporter.form)
@pytest.mark.parametrize("form", ["machine", "tree"])
@pytest.mark.usefixtures("file")
def test_it_has_the_bits_of_the_simulation(exporter: Exporter, form: str, tmp_path: Path) -> None:
    moved = 0
    for seed in range(4) if exporter.form in {"c", "cpp", "python"} else [2]:  # the others take these
        specification = controller(seed, form=form)
        folder = tmp_path / str(seed)
        write(exporter.files(subject(specification), "robot"), folder)
        sequences = draw_random_sequences(specification, 300)
        moved += len(np.unique(sequences.actuators, axis=0))
        assert measure_difference(sequences, exporter.run(folder, "robot", sequences)) == (0.0, 0)
    assert moved > 200


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"behaviours": ["woven.py:Shy"]},
        {"conditions": ["woven.py:Lit"]},
        {"behaviours": ["stop"], "conditions": ["woven.py:Elapsed"]},
        {"form": "tree", "behaviours": ["woven.py:Weave"], "conditions": ["black_floor"]},
    ],
)
@pytest.mark.usefixtures("file")
def test_it_compiles_without_warnings(options: dict[str, Any], tmp_path: Path) -> None:
    made = subject(controller(1, **options))
    for compiler in COMPILERS:
        folder = tmp_path / compiler
        write(C().files(made, "robot"), folder)
        words = [compiler, "-O2", "-std=c99", *STRICT, "robot.c", "robot_test.c", "-o", "self_test"]
        run(words, folder, compiler)
        assert run(["./self_test"], folder, compiler) == b"ok\n"
    write(Cpp().files(made, "robot"), tmp_path / "cpp")
    options_ = [*STRICT, "-std=c++11", "-fno-exceptions", "-fno-rtti"]
    run(["g++", *options_, "robot_test.cpp", "-o", "self_test"], tmp_path / "cpp", "g++")
    assert run(["./self_test"], tmp_path / "cpp", "g++") == b"ok\n"


@pytest.mark.slow
def test_python_copies_the_files(file: Path, tmp_path: Path) -> None:
    made = subject(controller(1))
    write(Python().files(made, "robot"), tmp_path / "robot")
    copied = tmp_path / "robot" / "robot_modules" / "code" / "woven.py"
    assert copied.read_bytes() == file.read_bytes()
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert f"woven.py  SHA-256 {digest}" in (tmp_path / "robot" / "robot.py").read_text()
    assert run([sys.executable, "robot_test.py"], tmp_path / "robot", "the self-test") == b"ok\n"

    # What was exported may be exported again; what was edited may not be lost.
    write(Python().files(made, "robot"), tmp_path / "robot")
    copied.write_text(f"{CODE}# edited")
    with pytest.raises(InputError, match=r"code/woven\.py: already exists and was not exported"):
        write(Python().files(made, "robot"), tmp_path / "robot")
    with pytest.raises(RunError, match="differs from the code with which the controller was designed"):
        run([sys.executable, "robot_test.py"], tmp_path / "robot", "the self-test")
    copied.unlink()
    with pytest.raises(RunError, match=r"cannot be read .*; copy the whole folder robot_modules"):
        run([sys.executable, "robot_test.py"], tmp_path / "robot", "the self-test")


HELPER = '''"""What several modules need."""

FACTOR = 3


def later():
    import other

    return other.SIGN
'''


def with_helper(folder: Path) -> dict[str, Any]:
    """Return a controller whose code has neighbours, one of which is imported in a step."""
    changed = CODE.replace("import numpy as np", "import helper\nimport numpy as np")
    changed = changed.replace("attraction[:, 1] * 3", "attraction[:, 1] * helper.FACTOR * -helper.later()")
    (folder / "woven.py").write_text(changed)
    (folder / "helper.py").write_text(HELPER)
    (folder / "other.py").write_text("SIGN = -1")
    return controller(1, behaviours=["woven.py:Shy"])


PROGRAM = """
import sys
sys.path.insert(0, "robot")
sys.path.insert(0, "elsewhere")
import helper
import swarmwright.controllers.modules
from robot import Controller
one = Controller()
first = one.step([0.5] * 9)
import helper, other
assert "elsewhere" in helper.__file__ and "elsewhere" in other.__file__
assert swarmwright.__file__
assert swarmwright.modules.Behaviour.__module__ == "swarmwright.controllers.modules._base"
assert first == [1.0, -0.5], first
print("ok")
"""


@pytest.mark.slow
def test_the_code_finds_its_neighbours_and_others_find_theirs(file: Path, tmp_path: Path) -> None:
    write(Python().files(subject(with_helper(file.parent)), "robot"), tmp_path / "robot")
    for name in ("helper.py", "other.py", "woven.py"):
        (tmp_path / name).unlink()
    (tmp_path / "elsewhere").mkdir()
    for name in ("helper.py", "other.py"):
        (tmp_path / "elsewhere" / name).write_text("")
    assert run([sys.executable, "-c", PROGRAM], tmp_path, "the program") == b"ok\n"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("import swarmwright.testing", r"woven\.py:3: imports swarmwright\.testing, but an exported"),
        (
            "from swarmwright.controllers.modules import BEHAVIOURS",
            r"woven\.py:3: imports swarmwright\.controllers\.modules\.BEHAVIOURS",
        ),
        ("from swarmwright import optimize", r"woven\.py:3: imports swarmwright\.optimize"),
    ],
)
def test_what_robots_lack_is_not_imported(file: Path, line: str, message: str) -> None:
    file.write_text(CODE.replace("import numpy", f"{line}\nimport numpy"))
    with pytest.raises(InputError, match=message):
        Python().files(subject(controller(1)), "robot")
    file.write_text(f"{CODE}\n\nif __name__ == '__main__':\n    {line}\n")
    Python().files(subject(controller(1)), "robot")


@pytest.mark.usefixtures("file")
def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "woven.py").write_text(f"{CODE}# another\n")
    made = subject(controller(1, behaviours=["woven.py:Shy"], conditions=["other/woven.py:Lit"]))
    with pytest.raises(InputError, match=r"Lit: its woven\.py differs from that of another module"):
        Python().files(made, "robot")


@pytest.mark.usefixtures("file")
def test_forms_without_python_and_c_say_so() -> None:
    made = subject(controller(1, behaviours=["woven.py:Shy"], conditions=["woven.py:Lit"]))
    for exporter, name in ((MicroPython(), "MicroPython"), (Onnx(), "ONNX")):
        message = f"{name} does not support its Python modules Shy, Lit; use --to python"
        with pytest.raises(InputError, match=message):
            exporter.files(made, "robot")


TEXT = """simulation: arena
parameters: {mission: aac, robot: e-puck-rm1.2, robots: 3, duration: 5}
controller:
  kind: modules
  behaviours: [woven.py:Weave]
  conditions: [woven.py:Elapsed, woven.py:Lit]
method: {kind: random_search, population: 4, generations: 1}
"""


@pytest.mark.slow
def test_a_run_is_exported_and_verified(file: Path, tmp_path: Path) -> None:
    experiment = tmp_path / "woven.yaml"
    experiment.write_text(TEXT)
    finished = optimize(Experiment.load(experiment), out=tmp_path / "run")
    exported = export_controller(finished, to="c", output=tmp_path / "c", verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    assert exported.verification.episode_steps > 100

    file.rename(tmp_path / "gone.py")  # the run has a copy
    exported = export_controller(finished, to="python", output=tmp_path / "python", verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    assert exported.verification.random_steps > 10_000

    file.write_text(CODE.replace("random_unit(3) * turn", "random_unit(4) * turn"))
    finished = optimize(Experiment.load(experiment), out=tmp_path / "other")
    with pytest.raises(RunError, match="the actuators differ from those of the simulation"):
        export_controller(finished, to="c", output=tmp_path / "other_c", verify=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '    c_code = "probability',
            '    c_not = "probability',
            r"woven\.py:\d+\) has no C code; set the attribute c_code",
        ),
        ('"growth"', '"long"', r"Weave: parameter 'long': is a reserved name in C; rename it"),
        ('"growth"', '"state"', r"Weave: parameter 'state': is a reserved name in C; rename it"),
        (
            '    c_code = "probability',
            '    c_code = 3 # "',
            r"Lit: c_code must be a string of C statements, not 3",
        ),
    ],
)
def test_what_cannot_be_exported_is_said(file: Path, old: str, new: str, message: str) -> None:
    assert old in CODE
    file.write_text(CODE.replace(old, new))
    made = subject(controller(1))
    for exporter in (C(), Cpp()):
        with pytest.raises(InputError, match=message):
            exporter.files(made, "robot")


@pytest.mark.slow
def test_code_that_does_not_compile_is_shown(file: Path, tmp_path: Path) -> None:
    file.write_text(CODE.replace("left = away;", "left = nonsense;"))
    specification = controller(1)
    write(C().files(subject(specification), "robot"), tmp_path / "c")
    with pytest.raises(RunError, match="nonsense"):
        C().run(tmp_path / "c", "robot", draw_random_sequences(specification, 2))
