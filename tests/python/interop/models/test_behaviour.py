"""Behaviours in SCXML: controllers that evolution starts from."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Controller, Experiment, InputError, Run, export_controller, optimize, simulate
from swarmwright.interop import models
from tests.python.interop.models.conftest import Edited

WALK = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" initial="approach" name="walk">
  <state id="approach">
    <onentry><assign location="heading" expr="0"/></onentry>
    <transition cond="defender_x &gt; 0 &amp;&amp; defender_x &lt; 0.2" target="evade"/>
  </state>
  <state id="evade">
    <onentry><assign location="heading" expr="0.5"/></onentry>
    <transition cond="defender_x &lt;= 0 || defender_x &gt;= 0.2" target="approach"/>
  </state>
</scxml>
"""


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    path = tmp_path / "walk.scxml"
    path.write_text(WALK)
    return path


def test_evolution_starts_from_a_behaviour(edited: Edited, walk: Path, tmp_path: Path) -> None:
    imported = models.load([edited("problem.xml"), walk], target=tmp_path / "drawn.yaml")
    assert list(imported.files) == ["drawn.controller.json"]
    experiment = imported.experiment.replace(servers="local", method={"population": 10, "generations": 2})
    assert experiment.controller.kind == "mealy_fsm"
    run = Run.open(optimize(experiment, out=tmp_path / "run").path)
    drawn = Controller(json.loads(imported.files["drawn.controller.json"]))
    first = run.evaluation(0, generation=0)
    assert first.genome.tolist() == drawn.specification["weights"]
    assert simulate(experiment, drawn) == first.fitness
    assert run.best.fitness >= first.fitness


def test_the_behaviour_needs_a_place(edited: Edited, walk: Path) -> None:
    with pytest.raises(InputError, match=r"walk\.scxml: is written to a file beside the experiment"):
        models.load([edited("problem.xml"), walk])


def test_optimised_parameters_come_first_where_agents_steer_themselves(
    drawn: list[Path], walk: Path, tmp_path: Path
) -> None:
    imported = models.load([*drawn, walk], target=tmp_path / "x.yaml")
    assert imported.experiment.controller.kind == "parameter_set"
    assert any("the behaviour is not used" in note for note in imported.notes)
    other = models.load([*drawn, walk], target=tmp_path / "x.yaml", controller="mealy_fsm")
    assert other.experiment.controller.kind == "mealy_fsm"
    assert other.experiment.start_from is not None


def test_names_of_another_simulation_are_reported(edited: Edited, walk: Path, tmp_path: Path) -> None:
    problem = edited(
        "problem.xml",
        ("minisim.Minisim", "emergencyexit.EmergencyExit"),
        ('"4"', '"10"'),
        ('er" type="INT" value="1"', 'er" type="INT" value="2"'),
    )
    with pytest.raises(InputError, match=r"walk\.scxml:\d: unknown actuator 'heading'") as caught:
        models.load([problem, walk], target=tmp_path / "x.yaml")
    assert "walk.scxml:4: unknown sensor 'defender_x'" in str(caught.value)


def test_a_simulation_that_is_not_built_in_has_the_sensors_of_the_file(
    edited: Edited, tmp_path: Path
) -> None:
    path = tmp_path / "walk.scxml"
    path.write_text(WALK.replace("<state", '<datamodel><data id="defender_x"/></datamodel><state', 1))
    problem = edited("problem.xml", ("minisim.Minisim", "a.Coverage"), ('value="4"', 'value="1"'))
    experiment = models.load([problem, path], target=tmp_path / "x.yaml").experiment
    assert (experiment.sensors, experiment.actuators) == (1, 1)


@pytest.mark.slow
@pytest.mark.usefixtures("walk")
def test_the_command_line(program: Any, edited: Edited, tmp_path: Path) -> None:
    edited("problem.xml")
    done = program("import", "problem.xml", "walk.scxml", "-o", "drawn.yaml")
    assert done.returncode == 0, done.stderr
    assert "The behaviour is in drawn.controller.json" in done.stdout
    shown = program("simulate", "drawn.yaml", "--controller", "drawn.controller.json")
    assert shown.returncode == 0, shown.stderr
    (tmp_path / "drawn.yaml").unlink()
    whole = program("import", ".", "-o", "again.yaml")
    assert whole.returncode == 0, whole.stderr
    again = program("import", "problem.xml", "walk.scxml", "-o", "drawn.yaml")
    assert again.returncode == 2
    assert "'drawn.controller.json' already exists" in again.stderr
    assert not (tmp_path / "drawn.yaml").exists()


SIMULATION = """
from swarmwright import Simulation


class Lab(Simulation):
    title = "lab"
    sensors = 2
    sensor_names = ["light+", "light-"]
    actuators = 1
    actuator_names = ["κινητήρας"]
    max_agents = 1

    def reset(self, parameters, seed):
        self.steps, self.sum = 0, 0.0
        return [[0.3, -0.3]]

    def step(self, actions):
        self.steps += 1
        self.sum += float(actions[0, 0]) * self.steps
        return [[0.1 * self.steps - 0.3, 0.5 - 0.2 * self.steps]]

    def done(self):
        return self.steps >= 5

    def fitness(self):
        return self.sum
"""


@pytest.mark.slow
def test_an_exported_behaviour_is_imported_with_the_same_sensors(tmp_path: Path) -> None:
    (tmp_path / "lab.py").write_text(SIMULATION, encoding="utf-8")
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{tmp_path / 'lab.py'}:Lab",
            "controller": {"kind": "mealy_fsm", "states": 2, "levels": [[-0.1, 0.2], 1]},
            "method": {"population": 8, "generations": 2},
        }
    )
    run = Run.open(optimize(experiment, out=tmp_path / "run").path)
    export_controller(run, to="scxml", output=tmp_path / "exported")
    imported = models.load(
        [tmp_path / "exported" / "controller.scxml"],
        target=tmp_path / "x.yaml",
        simulation=f"{tmp_path / 'lab.py'}:Lab",
    )
    (text,) = imported.files.values()
    assert json.loads(text)["thresholds"] == run.best.controller.specification["thresholds"]
    assert simulate(experiment, Controller(json.loads(text))) == run.best.fitness
