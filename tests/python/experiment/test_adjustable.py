"""Parameters that can be changed one by one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, evaluate, post_evaluate
from swarmwright.experiment.adjustable import Adjustable, list_adjustable
from swarmwright.experiment.settings import parameter_settings


def listed(values: dict[str, Any]) -> dict[str, Adjustable]:
    return {adjustable.key: adjustable for adjustable in list_adjustable(Experiment.from_mapping(values))}


def test_what_is_set_comes_first_and_the_seed_is_left_out() -> None:
    adjustables = listed({"simulation": "minisim", "parameters": {"seed": 3, "maxSteps": 9}})
    assert next(iter(adjustables)) == "maxSteps"
    assert adjustables["maxSteps"].value == 9
    assert adjustables["maxSteps"].kind == "integer"
    assert not adjustables["captureRadius"].is_set
    assert adjustables["captureRadius"].kind == "number"
    assert "seed" not in adjustables
    assert "agents" not in adjustables  # a list of positions, by default none


def test_robots_and_noise_of_a_mission_by_name() -> None:
    adjustables = listed({"simulation": "arena", "parameters": {"mission": "foraging"}})
    assert adjustables["robots"].value == 20
    assert adjustables["robot.drive.noise"].value == 0.05
    assert adjustables["robot.sensors.range_and_bearing.loss"].value == 0.85
    assert "dispersion" in adjustables["mission"].choices
    assert adjustables["duration"].value == 120
    patch = adjustables["mission.floor.patches.1.circle.radius"]
    assert (patch.kind, patch.is_set) == ("number", False)


def test_listed_defaults_of_the_arena_are_those_of_the_engine() -> None:
    mission: dict[str, Any] = {
        "walls": {"rectangle": [3, 3]},
        "start": {"disc": {"radius": 1}},
        "floor": {
            "patches": [{"name": "spot", "circle": {"center": [0, 0], "radius": 0.5}, "color": "black"}]
        },
        "lights": [{"at": [1, 0, 0.75], "intensity": 5}],
        "metrics": {"spread": {"kind": "nearest_distance"}},
        "fitness": "spread",
    }
    experiment = Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"mission": mission}, "controller": {"kind": "evostick"}}
    )
    defaults = {
        adjustable.key: adjustable.value
        for adjustable in list_adjustable(experiment)
        if adjustable.key in {"robots", "duration"} or adjustable.key.startswith("robot.")
    }
    genomes = np.random.default_rng(1).uniform(-1, 1, (2, experiment.genome_size)).astype(np.float32)
    expected = evaluate(experiment, genomes, servers="in-process")

    def is_same(values: dict[str, Any]) -> bool:
        changed = experiment.with_settings(parameter_settings(values))
        return np.array_equal(evaluate(changed, genomes, servers="in-process"), expected)

    assert len(defaults) == 7
    assert is_same(defaults)
    for key, value in defaults.items():
        assert not is_same({key: value * 0.9 if value < 1 else value - 1}), key


def test_declared_limits_and_odd_names(tmp_path: Path) -> None:
    file = tmp_path / "world.py"
    file.write_text(
        "import swarmwright\n"
        "from swarmwright import Parameter\n"
        "class World(swarmwright.Simulation):\n"
        "    sensors, actuators = 1, 1\n"
        "    parameters = {'a.b': Parameter(2.0, 'metres', minimum=0.5, maximum=3.0),\n"
        "                  'kind': Parameter('x', choices=['x', '<b>']), 'q\"': 1, 'on': True}\n"
        "    def reset(self, parameters, seed): ...\n"
        "    def step(self, actuators): ...\n"
        "    done, fitness = False, 0.0\n"
    )
    adjustables = listed({"simulation": f"{file}:World", "parameters": {"a.b": 1}})
    assert adjustables['"a.b"'].minimum == 0.5
    assert adjustables['"a.b"'].maximum == 3.0
    assert adjustables['"a.b"'].kind == "number"
    assert adjustables["kind"].choices == ("x", "<b>")
    assert adjustables["on"].kind == "boolean"
    assert 'q"' not in adjustables
    assert parameter_settings({'"a.b"': 2})[0].path == ("parameters", "a.b")


@pytest.mark.parametrize("key", ["", "a=b", "a..b", ".a", "a[", "seed", '"'])
def test_other_keys_are_refused(key: str) -> None:
    with pytest.raises(InputError, match="parameters"):
        parameter_settings({key: 1})


def test_robots_and_parts_of_the_robot_are_set_together() -> None:
    experiment = Experiment.from_mapping({"simulation": "arena", "parameters": {"mission": "aggregation"}})
    changed = experiment.with_settings(parameter_settings({"robots": 40, "robot.drive.noise": 0.1}))
    assert changed.parameters["robots"] == 40
    assert changed.parameters["robot"] == {"preset": "e-puck-rm1.1", "drive": {"noise": 0.1}}


def test_a_candidate_is_evaluated_with_other_parameters(finished: Run) -> None:
    same: dict[str, Any] = {"episodes": 4, "servers": "in-process"}
    changed = post_evaluate(finished, parameters={"speedAgents": 0.0}, **same)
    assert changed.seeds == post_evaluate(finished, **same).seeds
    assert changed.mean.mean < post_evaluate(finished, **same).mean.mean
    page = finished.replay(parameters={"maxSteps": 2}, seed=3)
    assert page.seed == 3
    with pytest.raises(InputError, match=r"^parameters\.maxSteps: -1 found"):
        finished.replay(parameters={"maxSteps": -1})
