"""Swarms of the arena with kinds of robots that have different drives and messages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, Run, export_controller, optimize, post_evaluate
from swarmwright.experiment.robots import list_kinds
from swarmwright.simulations import catalogue
from tests.python.records import same_record

FLOATING = f"{Path(__file__).with_name('floating.py')}:Floating"


def heard(numbers: int) -> dict[str, Any]:
    """Return the sensors of a robot that hears messages, and a message of so many values."""
    sensors = [
        {"kind": "range_and_bearing", "range": 2, "gives": ["sectors", "message"]},
        {"kind": "light", "count": 2},
    ]
    return {
        "radius": 0.04,
        "sensors": sensors,
        "actuators": [{"kind": "message", "numbers": numbers}] if numbers else [],
    }


ROBOTS: list[dict[str, Any]] = [
    {
        "name": "wheels",
        "count": 3,
        "robot": {
            **heard(1),
            "drive": {"kind": "differential", "wheel_base": 0.06, "max_speed": 0.2, "noise": 0.05},
        },
    },
    {
        "name": "floating",
        "count": 2,
        "robot": {**heard(3), "drive": {"kind": "holonomic", "max_speed": 0.3, "max_turn": 90}},
    },
    {
        "name": "cars",
        "count": 2,
        "robot": {
            **heard(0),
            "drive": {"kind": "car", "wheel_base": 0.06, "max_speed": 0.3, "max_steering": 30},
        },
    },
]
GROUPS = {
    "wheels": {"kind": "layered", "hidden": [3]},
    "floating": {"kind": "fully_meshed", "hidden": 1},
    "cars": {"kind": "layered", "hidden": []},
}
ACTUATORS = [
    "wheels left wheel",
    "wheels right wheel",
    "floating ahead",
    "floating left",
    "floating turn",
    "cars speed",
    "cars steering",
    "wheels and floating message 0",
    "floating message 1",
    "floating message 2",
]


def experiment(**changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "arena",
            "parameters": {"mission": "aggregation", "duration": 4, "robots": ROBOTS},
            "controller": {"kind": "team", "groups": GROUPS},
            "method": {"population": 6, "generations": 2},
            "ranking": {"episodes": 2},
            "validate": False,
            **changes,
        }
    )


SHARED = {"controller": {"kind": "layered", "hidden": [3]}}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(experiment(), servers="in-process", out=tmp_path_factory.mktemp("team") / "run")


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_record_of_a_team_is_the_same_on_servers(mode: str, run: Run, tmp_path: Path) -> None:
    found = optimize(experiment(mode=mode), servers=1, out=tmp_path / "run")
    same_record(found, run)
    assert {attempt.mode for attempt in found.attempts()} == {mode}


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_the_record_of_one_controller_for_all_is_the_same_on_servers(mode: str, tmp_path: Path) -> None:
    # In this process, episodes are computed in lanes.
    here = optimize(experiment(**SHARED), servers="in-process", out=tmp_path / "here")
    same_record(optimize(experiment(**SHARED, mode=mode), servers=2, out=tmp_path / "there"), here)


@pytest.mark.slow
def test_another_simulator_moves_the_robots(tmp_path: Path) -> None:
    wanted = experiment(simulation=FLOATING)
    here = optimize(wanted, servers="local", out=tmp_path / "here")
    assert np.isfinite(here.record.fitness).all()
    same_record(optimize(wanted.replace(mode="stepwise"), servers=1, out=tmp_path / "there"), here)


@pytest.mark.slow
def test_groups_have_the_sensors_and_actuators_of_all_kinds(run: Run) -> None:
    assert (run.experiment.sensors, run.experiment.actuators) == (4 + 3 + 2, 10)
    groups = catalogue.groups("arena", run.experiment.parameters)
    assert [(one.name, one.agents) for one in groups] == [("wheels", 3), ("floating", 2), ("cars", 2)]
    assert all(list(one.actuator_names) == ACTUATORS for one in groups)
    controller: Controller = run.best.controller
    assert [one.actuators for one in controller.groups.values()] == [10] * 3
    more = [{**one, "count": one["count"] + 2} for one in ROBOTS]
    changed = run.experiment.replace(parameters={**run.experiment.parameters, "robots": more})
    assert len(post_evaluate(run, episodes=2, experiment=changed).measured) == 2


@pytest.mark.slow
def test_exports_name_the_kinds(run: Run, tmp_path: Path) -> None:
    found = export_controller(run, to="python", group="cars", verify=True, output=tmp_path / "cars")
    assert found.verification is not None
    assert found.verification.ok
    assert [one.name for one in found.subject.actuators] == ACTUATORS
    shared = optimize(experiment(**SHARED), servers="in-process", out=tmp_path / "shared")
    found = export_controller(shared, to="python", output=tmp_path / "all")
    assert [one.name for one in found.subject.actuators] == ACTUATORS


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"controller": {"kind": "team", "groups": {"wheels": {}, "cars": {}}}},
            "controller.groups: floating missing",
        ),
        (
            {"controller": {"kind": "modules"}},
            r"modules needs 9 sensors .* has 9 and 10; use a robot such as e-puck-rm1\.2 of arena for all",
        ),
        (
            {"parameters": {"robots": [ROBOTS[0], {**ROBOTS[1], "name": "wheels"}]}},
            r'parameters.robots\[1\].name: another kind is already named "wheels"',
        ),
        (
            {"parameters": {"robots": [{**ROBOTS[2], "count": 5}, {"robot": "e-puck-rm1.1", "count": 2}]}},
            r"parameters.robots\[0\].robot.sensors\[0\].gives\[1\]: no message is sent; add an actuator",
        ),
    ],
)
def test_mistakes_say_what_and_where(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        experiment(**changes)


def test_what_each_kind_has_is_known() -> None:
    robots = [one | {"count": 2 + index} for index, one in enumerate(ROBOTS)]
    wheels, floating, cars = list_kinds("arena", {"robots": robots})
    assert [one.agents for one in (wheels, floating, cars)] == [2, 3, 4]
    # All hear the longest message; what is sent and driven differs.
    for one in (wheels, floating, cars):
        assert None not in one.sensors
        assert one.sensors == wheels.sensors
    assert [name for name in wheels.actuators if name] == ["left wheel", "right wheel", "message 0"]
    assert [name for name in floating.actuators if name] == [
        "ahead", "left", "turn", "message 0", "message 1", "message 2",
    ]  # fmt: skip
    assert sum(name is not None for name in cars.actuators) == 2


def test_kinds_with_other_sensors_have_names_of_their_own() -> None:
    near = {"kind": "proximity", "count": 2, "range": 0.1}
    robots = [
        {"name": "a", "count": 1, "robot": {**heard(0), "sensors": [near, {"kind": "light", "count": 2}]}},
        {"name": "b", "count": 2, "robot": {**heard(0), "sensors": [{"kind": "light", "count": 3}]}},
        {"name": "c and d", "count": 2, "robot": {**heard(0), "sensors": [{"kind": "compass"}]}},
    ]
    for one in robots:
        one["robot"]["drive"] = {"kind": "differential", "wheel_base": 0.06, "max_speed": 0.2}  # type: ignore[index]
    of_a, of_b, of_c = list_kinds("arena", {"robots": robots})
    assert [name for name in of_a.sensors if name] == ["proximity 0", "proximity 1", "light 0", "light 1"]
    assert [name for name in of_b.sensors if name] == ["light 0", "light 1", "light 2"]
    assert not {i for i, name in enumerate(of_a.sensors) if name} & {
        i for i, name in enumerate(of_b.sensors) if name
    }
    assert [name for name in of_c.sensors if name]
    assert list_kinds("arena", {}) == []
    assert list_kinds("minisim", {}) == []
