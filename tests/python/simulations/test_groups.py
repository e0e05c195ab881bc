"""Several kinds of agents in one experiment give one record, however it is computed."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Controller,
    Experiment,
    Group,
    InputError,
    Run,
    evaluate,
    export_controller,
    optimize,
    post_evaluate,
    simulate,
)
from swarmwright.common.errors import SimulationError
from swarmwright.controllers.figures import figure
from swarmwright.runs.replay import Replay
from swarmwright.simulations.host import Host, describe
from tests.python.records import same_record
from tests.python.simulations.pursuit import Pursuit

GROUPS: dict[str, Any] = {
    "hunters": {"kind": "layered", "hidden": [3]},
    "prey": {"kind": "fully_meshed", "hidden": 1},
}
DEFENDERS = {"placement": "random", "numAgents": 2, "numDefenders": 3, "defenderSteering": "controller"}


def experiment(simulation: Any = Pursuit, groups: Any = None, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "controller": {"kind": "team", "groups": GROUPS if groups is None else groups},
            "method": {"population": 8, "generations": 2},
            "ranking": {"episodes": 2},
            **changes,
        }
    )


def minisim(**changes: Any) -> Experiment:
    groups = {"agents": {"hidden": [3]}, "defenders": {"kind": "fully_meshed", "hidden": 1}}
    return experiment("minisim", groups, **{"parameters": DEFENDERS, **changes})


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(experiment(), servers="in-process", out=tmp_path_factory.mktemp("here") / "run")


@pytest.fixture(scope="module")
def built_in(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(minisim(), servers="in-process", out=tmp_path_factory.mktemp("minisim") / "run")


def test_the_genome_is_that_of_all_groups(run: Run) -> None:
    # 1-3-1 with biases; 3 inputs, 1 hidden and 2 outputs, of which each has 6 weights and a bias.
    assert run.experiment.genome_size == 3 * 2 + 4 + 3 * 7
    groups = run.best.controller.groups
    assert [(one.sensors, one.actuators) for one in groups.values()] == [(1, 1), (3, 2)]
    assert vars(run.experiment.controller)["groups"]["prey"].agents == 1


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_record_is_the_same_on_servers(mode: str, run: Run, built_in: Run, tmp_path: Path) -> None:
    found = optimize(experiment(mode=mode), servers=1, out=tmp_path / "run")
    same_record(found, run)
    assert {attempt.mode for attempt in found.attempts()} == {mode}
    same_record(optimize(minisim(mode=mode), servers=2, out=tmp_path / "minisim"), built_in)


@pytest.mark.slow
def test_agents_have_the_controllers_of_their_groups() -> None:
    wanted = experiment(parameters={"hunters": 3})
    controller = Controller(wanted.representation().specification(_genome(wanted)))
    rows = np.array([[0.5, 9, 9], [-0.25, 9, 9], [0.125, 9, 9], [0.1, 0.2, 0.3]], dtype=np.float32)
    found = controller(rows)
    assert found.shape == (4, 2)
    hunters = controller.groups["hunters"](rows[:3, :1])
    assert found[:3, 0].tobytes() == hunters[:, 0].tobytes()
    assert not found[:3, 1].any()
    assert found[3].tobytes() == controller.groups["prey"](rows[3]).tobytes()
    # By hand: the same episode.
    simulation, fitness = Pursuit(), simulate(wanted, controller, servers=None, seed=4)
    seen = simulation.reset({"hunters": 3}, 4)
    controller.reset()
    while not simulation.done():
        rows = np.zeros((4, 3), dtype=np.float32)
        for row, numbers in zip(rows, seen, strict=True):
            row[: len(numbers)] = numbers
        seen = simulation.step(controller(rows))
    assert simulation.fitness() == fitness


def _genome(wanted: Experiment) -> Any:
    return np.random.default_rng(1).uniform(-1, 1, wanted.genome_size).astype(np.float32)


def test_numbers_of_agents_follow_the_parameters(run: Run) -> None:
    changed = run.experiment.replace(parameters={"hunters": 5})
    assert vars(changed.controller)["groups"]["hunters"].agents == 5
    assert changed.genome_size == run.experiment.genome_size
    assert np.isfinite(evaluate(changed, _genome(changed)[np.newaxis], servers="in-process")).all()


@pytest.mark.slow
def test_a_group_is_exported_by_itself(run: Run, built_in: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name a group, hunters, prey"):
        export_controller(run, to="python", output=tmp_path / "none")
    with pytest.raises(InputError, match="no group 'pray'; did you mean 'prey'"):
        export_controller(run, to="python", group="pray", output=tmp_path / "none")
    for name in GROUPS:
        found = export_controller(run, to="python", group=name, verify=True, output=tmp_path / name)
        assert found.verification is not None
        assert found.verification.ok
        assert found.subject.episode_count
        assert found.files[0].name == f"{name}.py"  # of a group, by default
    with pytest.raises(InputError, match="contains the controller of the group hunters; choose another"):
        export_controller(run, to="python", group="prey", prefix="hunters", output=tmp_path / "hunters")
    named = export_controller(built_in, to="python", group="defenders", output=tmp_path / "named")
    assert [one.name for one in named.subject.sensors] == ["agent x", "agent y", "goal x", "goal y"]


@pytest.mark.journey
def test_a_run_is_drawn_replayed_and_evaluated(run: Run) -> None:
    assert len(figure(run.best.controller.specification).axes) == 2
    found = post_evaluate(run, episodes=3)
    assert len(found.measured) == 3
    episode = Replay.of(run).engine_episode()
    widths = set()
    while not episode.done:
        agents, sensors, actuators = episode.step_observed()
        widths.add((len(agents), sensors.shape[1], actuators.shape[1]))
    assert widths == {(3, 3, 2)}


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"hunters": {}}, "controller.groups: prey missing"),
        ({**GROUPS, "pray": {}}, "controller.groups.pray: unknown group; did you mean 'prey'"),
        ({**GROUPS, "prey": {"sensors": 4}}, "controller.groups.prey.sensors: .*has 3, not 4"),
        ({**GROUPS, "hunters": {"agents": 4}}, "controller.groups.hunters.agents: .*has 2, not 4"),
        ({**GROUPS, "prey": {"kind": "layerd"}}, "controller.groups.prey: .*did you mean 'layered'"),
        ({**GROUPS, "prey": {"hiden": [1]}}, "controller.groups.prey.hiden: unknown key"),
        ({**GROUPS, "prey": {"hidden": [0]}}, r"controller.groups.prey.hidden\[0\]: must be at least 1"),
        ({**GROUPS, "prey": {"kind": "parameter_set"}}, "controller.groups.prey: parameter_set steers no"),
        ({**GROUPS, "prey": {"kind": "team"}}, "controller.groups.prey: teams cannot be nested"),
        ({}, "controller.groups: must have at least 1"),
        (["hunters"], "controller.groups: must be a mapping"),
    ],
)
def test_mistakes_are_found_before_anything_runs(groups: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        experiment(groups=groups)


def test_a_simulation_without_groups_says_how_to_have_some() -> None:
    with pytest.raises(InputError, match="set the parameter defenderSteering: controller"):
        minisim(parameters={})


def test_groups_of_an_unknown_simulation_are_those_of_the_file() -> None:
    sizes = {"sensors": 3, "actuators": 1}
    with pytest.raises(InputError, match=r"controller.groups.one.agents: missing"):
        experiment("elsewhere", {"one": sizes, "two": sizes})
    found = experiment("elsewhere", {"one": {**sizes, "agents": 2}, "two": {"sensors": 5, "actuators": 2}})
    assert (found.sensors, found.actuators) == (5, 2)
    assert [one["agents"] for one in found.representation().architecture()["groups"]] == [2, None]
    assert Experiment.from_mapping(found.to_mapping()) == found


def test_what_a_class_declares_is_checked() -> None:
    sizes = Group(np.int64(2), np.int32(3), np.uint8(1))  # type: ignore[arg-type] # NumPy's integers
    found = describe(type("Sized", (Pursuit,), {"groups": {"a": sizes}})()).groups["a"]
    assert json.dumps([found.agents, found.sensors, found.actuators]) == "[2, 3, 1]"
    for groups, message in [
        ({"a": Group("none", 1, 1)}, "there is no parameter 'none'"),
        ({"a": Group(1, 0, 1)}, r"groups\['a'\].sensors: 0 found"),
        ({"a": (1, 1)}, r"groups\['a'\]: \(1, 1\) found"),
        ([1], "expected a mapping from names to Group"),
        ({"a": Group(1, 2, 1, sensor_names=["x"])}, "sensor_names: 1 found, expected 2"),
        ({"a": Group(1, 2, 1, sensor_ranges=[(0, 1)])}, "sensor_ranges: 1 ranges found, expected 2"),
    ]:
        kind = type("Wrong", (Pursuit,), {"groups": groups})
        with pytest.raises(InputError, match=message):
            describe(kind())


def test_rows_of_the_wrong_length_name_the_agent() -> None:
    class Long(Pursuit):
        def look(self) -> Any:
            return [[0.0], [0.0, 1.0], [0.0, 0.0, 0.0]]

    host_error = "agent 1 senses .*expected 1 numbers"
    with pytest.raises(SimulationError, match=host_error):
        Host(Long).reset({"hunters": 2})


def test_starting_from_a_team_with_other_numbers_of_agents(run: Run) -> None:
    wanted = experiment(parameters={"hunters": 4}, start_from=str(run.path))
    assert wanted.start_from is not None
    assert dataclasses.replace(wanted, start_from=None).genome_size == len(wanted.start_from[0]["weights"])
