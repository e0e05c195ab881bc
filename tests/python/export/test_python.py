"""Controllers in Python and MicroPython: the bits of the engine, without NumPy."""

import ast
import importlib.util
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from swarmwright import Experiment, InputError, Simulation, export_controller, optimize
from swarmwright.export import Exporter, Subject
from swarmwright.export.exporting import write
from swarmwright.export.micropython import MicroPython
from swarmwright.export.micropython import _find_interpreter as interpreter
from swarmwright.export.python import Python
from swarmwright.export.sequences import measure_difference
from tests.python.export.specifications import (
    ALL,
    NASTY,
    Specification,
    few,
    nasty,
    networks,
    sequences_of,
    subject,
)


def has_micropython() -> bool:
    try:
        interpreter()
    except InputError:
        assert "SWARMWRIGHT_TEST_EXPORT" not in os.environ
        return False
    return True


FORMS = [
    Python(),
    pytest.param(
        MicroPython(),
        marks=pytest.mark.skipif(not has_micropython(), reason="MicroPython: make test-export installs it"),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("exporter", FORMS, ids=lambda exporter: exporter.form)
def test_every_kind(exporter: Exporter, tmp_path: Path) -> None:
    names = [name for name in ALL if exporter.form == "python" or name[-1] in "0147ydm"]
    for name in names:
        write(exporter.files(subject(ALL[name]), "robot"), tmp_path)
        sequences = sequences_of(name, 30)
        assert measure_difference(sequences, exporter.run(tmp_path, "robot", sequences)) == (0.0, 0), name


@pytest.mark.slow
@pytest.mark.parametrize("exporter", FORMS, ids=lambda exporter: exporter.form)
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(specification=networks())
def test_any_network(exporter: Exporter, specification: Specification, tmp_path: Path) -> None:
    write(exporter.files(subject(specification), "robot"), tmp_path)
    sequences = few(specification, 30)
    assert measure_difference(sequences, exporter.run(tmp_path, "robot", sequences)) == (0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("exporter", FORMS, ids=lambda exporter: exporter.form)
@pytest.mark.parametrize("name", ["layered-tanh-0", "fully_meshed-tanh-6", "mealy_fsm", "layered-wide"])
def test_self_tests(exporter: Exporter, name: str, tmp_path: Path) -> None:
    write(exporter.files(subject(ALL[name]), "robot"), tmp_path)
    assert exporter.self_test(tmp_path, "robot") == "robot_test.py"


def loaded(made: Subject, folder: Path) -> ModuleType:
    """The exported module."""
    write(Python().files(made, "robot"), folder)
    spec = importlib.util.spec_from_file_location("robot", folder / "robot.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_overflow_is_refused_until_a_reset(tmp_path: Path) -> None:
    specification = ALL["fully_meshed-tanh-6"]
    large = {**specification, "weights": [100 * one for one in specification["weights"]]}
    controller = loaded(subject(large), tmp_path).Controller()
    with pytest.raises(ValueError, match="a node has overflowed"):
        controller.step([3e38, 3e38, -3e38])
    with pytest.raises(ValueError, match="reset the controller"):
        controller.step([0, 0, 0])
    controller.reset()
    assert len(controller.step([0, 0, 0])) == 2


def test_a_random_number_is_from_0_to_1(tmp_path: Path) -> None:
    controller = loaded(subject(ALL["modules"]), tmp_path).Controller()
    assert controller.step([0] * 8 + [1])
    for value in (-0.1, 12345):
        with pytest.raises(ValueError, match="expected 0 to 1"):
            controller.step([0] * 8 + [value])


def test_the_duration_of_a_step_is_in_the_module(tmp_path: Path) -> None:
    assert loaded(replace(subject(ALL["mealy_fsm"]), step_size=0.1), tmp_path).STEP_SECONDS == 0.1


@pytest.mark.slow
def test_micropython_on_python(tmp_path: Path) -> None:
    """The module for MicroPython is one for Python, too: with floats of 64 bits."""
    for name in ("fully_meshed-sigmoid-5", "mealy_fsm", "layered-deep"):
        files = MicroPython().files(subject(ALL[name]), "robot")
        assert "decimals" not in str(files["robot.py"]).partition('"""\n')[2]
        write(files, tmp_path)
        sequences = sequences_of(name)
        assert measure_difference(sequences, Python().run(tmp_path, "robot", sequences)) == (0.0, 0)
        assert Python().self_test(tmp_path, "robot") == "robot_test.py"


@pytest.mark.slow
def test_a_self_test_finds_a_wrong_weight(tmp_path: Path) -> None:
    specification = ALL["fully_meshed-tanh-6"]
    write(Python().files(subject(specification), "robot"), tmp_path)
    weight = np.float32(specification["weights"][0])
    source = tmp_path / "robot.py"
    assert f"{weight!s}," in source.read_text()
    source.write_text(source.read_text().replace(f"{weight!s},", f"{np.nextafter(weight, np.float32(9))!s},"))
    done = subprocess.run(
        [sys.executable, "robot_test.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "the actuators differ from those of the simulation" in done.stdout


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("robot", path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.mark.parametrize("exporter", [Python(), MicroPython()], ids=lambda exporter: exporter.form)
def test_sensors_that_are_refused(exporter: Exporter, tmp_path: Path) -> None:
    write(exporter.files(subject(ALL["fully_meshed-tanh-6"]), "robot"), tmp_path)
    robot = module(tmp_path / "robot.py")
    assert robot.SENSORS == ("sensor 0", "sensor 1", "sensor 2")
    one, other = robot.Controller(), robot.Controller()
    one.step([0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="2 sensors given, expected 3"):
        one.step([0.1, 0.2])
    for bad in (float("nan"), float("inf"), 1e39):
        with pytest.raises(ValueError, match=r"sensor sensor 1 is .*, expected a finite number"):
            one.step([0.1, bad, 0.3])
    # Nothing has changed, and each controller has a state of its own.
    other.step([0.1, 0.2, 0.3])
    assert one.step([0.4, 0.5, 0.6]) == other.step([0.4, 0.5, 0.6])
    one.reset()
    assert one.step([0.4, 0.5, 0.6]) != other.step([0.4, 0.5, 0.6])


def test_names_of_modules_are_refused() -> None:
    for exporter in (Python(), MicroPython()):
        with pytest.raises(InputError, match="prefix: 'array' is a Python module"):
            exporter.files(subject(ALL["mealy_fsm"]), "array")


def test_no_micropython(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("MICROPYTHON", raising=False)
    write(MicroPython().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    sequences = few(ALL["mealy_fsm"], 1)
    with pytest.raises(
        InputError, match="verification needs micropython, which is not installed: apt install"
    ):
        MicroPython().run(tmp_path, "robot", sequences)


@pytest.mark.slow
def test_names_cannot_leave_strings(tmp_path: Path) -> None:
    for exporter in (Python(), MicroPython()):
        folder = tmp_path / exporter.form
        write(exporter.files(nasty(), "robot"), folder)
        assert Python().self_test(folder, "robot") == "robot_test.py"
        named = module(folder / "robot.py").SENSORS
        assert len(set(named)) == len(NASTY)  # empty ones and those that occur twice are numbered
        assert all(
            new in (old, f"{old} {at}", f"sensor {at}")
            for at, (old, new) in enumerate(zip(NASTY, named, strict=True))
        )
        source = "from robot import ACTUATORS, Controller; print(len(Controller().step([0.0] * 6)))"
        said = subprocess.run(
            [sys.executable, "-S", "-c", source], cwd=folder, capture_output=True, check=True
        )
        assert said.stdout == b"6\n"
        page = (folder / "robot.py").read_text(encoding="utf-8")
        assert "\u202e" not in page  # which would show the rest of a line in another order


@pytest.mark.parametrize(
    "name",
    ["gr\N{LATIN SMALL LETTER O WITH DIAERESIS}\N{LATIN SMALL LETTER SHARP S}e", "a\\", "it's", 'say "x"'],
)
def test_names_are_those_of_the_simulation(name: str) -> None:
    described = {"sensor_names": [name, "a", "b"], "sensor_units": ["\N{DEGREE SIGN}", "", "m"]}
    made = replace(subject(ALL["fully_meshed-tanh-6"]), description=described)
    for exporter in (Python(), MicroPython()):
        text = str(exporter.files(made, "robot")["robot.py"])
        tuples = [ast.literal_eval(one.value) for one in ast.parse(text).body if _assigns(one, "SENSORS")]
        assert tuples == [(name, "a", "b")]
        assert "# in \N{DEGREE SIGN}, " in text


def _assigns(node: ast.stmt, name: str) -> TypeGuard[ast.Assign]:
    return isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name


def test_what_a_sender_writes_cannot_leave_the_docstring() -> None:
    """Facts of a bundle come from its sender; what is exported with them is run."""
    made = replace(subject(ALL["mealy_fsm"]), facts=(("Run", '"""\nraise SystemExit\n"""'),))
    for files in (Python().files(made, "robot"), MicroPython().files(made, "robot")):
        for text in files.values():
            statements = ast.parse(str(text)).body
            assert not any(isinstance(one, ast.Raise) for one in statements)


class Drift(Simulation):
    """Two agents that have to stop where they cannot measure how far they have come: state helps."""

    title, dimensions, sensors, actuators = "drift", 1, 2, 1

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:  # noqa: ARG002 - has none
        self.numbers = np.random.default_rng(seed)
        self.x, self.left = self.numbers.uniform(-1, 1, 2), 25
        return self._seen()

    def _seen(self) -> Any:
        return np.column_stack([np.sign(self.x), self.numbers.uniform(-1, 1, 2)])

    def step(self, actions: Any) -> Any:
        self.x = self.x + 0.1 * actions[:, 0]
        self.left -= 1
        return self._seen()

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        return -float(np.abs(self.x).sum())


@pytest.mark.slow
def test_exported_controllers_behave_as_in_the_run(tmp_path: Path) -> None:
    """In the loop with the simulation, 20 exported networks reach the fitness of the record, none another."""
    experiment = Experiment.from_mapping(
        {
            "simulation": Drift, "servers": "in-process", "ranking": {"episodes": 2},
            "controller": {"kind": "fully_meshed", "hidden": 2, "activation": "tanh"},
            "method": {"kind": "random_search", "population": 20, "generations": 1},
        }
    )  # fmt: skip
    found = optimize(experiment, out=tmp_path / "run")
    for candidate in range(20):
        export_controller(found, to="python", output=tmp_path, candidate=candidate, prefix="robot")
        robot = module(tmp_path / "robot.py")
        record = found.evaluation(candidate, 0)
        for seed, fitness in zip(record.seeds, record.episodes.tolist(), strict=True):
            simulation, agents = Drift(), [robot.Controller(), robot.Controller()]
            seen = simulation.reset({}, seed)
            while not simulation.done():
                rows: list[list[float]] = seen.astype(np.float32).tolist()
                actions = [agent.step(row) for agent, row in zip(agents, rows, strict=True)]
                seen = simulation.step(np.array(actions, np.float32))
            assert simulation.fitness() == fitness
