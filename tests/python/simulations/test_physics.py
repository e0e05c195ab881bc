"""Missions of the arena whose robots a class in Python moves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, RunError, _engine, optimize, simulate
from swarmwright.simulations import catalogue
from swarmwright.simulations.physics import Wall, World

FILE = Path(__file__).with_name("floating.py")


def experiment(kind: str = "Floating", **more: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": f"{FILE}:{kind}",
            "parameters": {"mission": "aggregation", "robots": 4, "duration": 4},
            "controller": {"kind": "evostick"},
            "method": {"kind": "evostick", "population": 5, "elites": 1, "generations": 2},
            "ranking": {"episodes": 2, "seeds": "new"},
            "validate": False,
            **more,
        }
    )


@pytest.mark.journey
def test_the_record_is_the_same_here_and_on_servers(tmp_path: Path) -> None:
    here = optimize(experiment(), out=tmp_path / "here", servers="local")
    for mode in ("offloaded", "stepwise", "batched"):
        there = optimize(experiment(mode=mode), out=tmp_path / mode, servers=2)
        assert there.digest == here.digest, mode


@pytest.mark.slow
def test_sensors_and_metrics_are_those_of_the_mission_and_the_robot() -> None:
    name = f"{FILE}:Floating"
    parameters = {"mission": "homing", "robot": "e-puck-rm1.2"}
    described = catalogue.description(name, parameters)
    of_arena = catalogue.description("arena", parameters)
    assert described == {**of_arena, "title": "arena-floating"}
    assert described["sensors"] != catalogue.description(name)["sensors"]
    machines = experiment(
        parameters={**parameters, "robots": 3, "duration": 3},
        controller={"kind": "modules"},
        method={"kind": "random_search", "population": 3, "generations": 1},
        fitness="fitness + order",
    )
    assert np.isfinite(optimize(machines).record.fitness).all()


def test_missions_come_from_files(tmp_path: Path) -> None:
    from swarmwright.cli.templates import mission

    (tmp_path / "mine.yaml").write_text(mission("aggregation"))
    text = f"simulation: {FILE}:Floating\nparameters: {{mission: mine.yaml, robots: 3, duration: 2}}\n"
    (tmp_path / "x.yaml").write_text(text + "controller: {kind: evostick}\nvalidate: false\n")
    loaded = Experiment.load(tmp_path / "x.yaml")
    assert loaded.parameters["mission"]["walls"]
    (tmp_path / "mine.yaml").write_text(mission("aggregation").replace("fitness:", "fitnes:"))
    with pytest.raises(InputError, match=r"mine\.yaml:\d+: "):
        Experiment.load(tmp_path / "x.yaml")


@pytest.mark.parametrize(
    ("kind", "more", "message"),
    [
        ("Titled", {}, "Titled.title: 'floating' found, expected arena-NAME"),
        ("Unfinished", {}, "Unfinished: has no method poses, start, step; a simulator of missions needs"),
        ("Floating", {"parameters": {"mission": "agregation"}}, '"agregation" found, expected the name'),
        ("Floating", {"parameters": {"agents": 3}}, "agents"),
        ("Flying", {}, "has no class 'Flying'"),
    ],
)
def test_mistakes_are_told_before_anything_runs(kind: str, more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        optimize(experiment(kind, **more), servers="local")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Lost", "Lost.poses: number 1 of row 2 is nan, expected a finite number"),
        (
            "Short",
            r"Short.poses: float64 of the shape \(3, 3\) returned, expected numbers of the shape \(4, 3\)",
        ),
        (
            "Alone",
            "Alone.poses: an array of float64 of the shape .* returned, expected a tuple: poses of robots",
        ),
        ("Broken", r"Broken.step: ZeroDivisionError: division by zero \(.*floating.py:\d+\)"),
    ],
)
@pytest.mark.parametrize("servers", ["local", 1])
def test_what_fails_says_why(kind: str, message: str, servers: Any) -> None:
    with pytest.raises(RunError, match=message):
        optimize(experiment(kind, ranking={"failed": "stop"}), servers=servers)


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["local", 1])
def test_the_simulator_may_refuse_parameters(servers: Any) -> None:
    many = experiment(parameters={"mission": "aggregation", "robots": 51, "duration": 1})
    with pytest.raises((InputError, RunError), match="robots: at most 50 are possible here"):
        optimize(many, servers=servers)


def test_rays_of_the_simulator_count() -> None:
    def sensed(kind: str, steps: int) -> np.ndarray[Any, Any]:
        host = catalogue.make_playable(f"{FILE}:{kind}")
        robot = {"preset": "e-puck-rm1.1", "sensors": {"proximity": {"noise": 0}}}
        parameters = {"mission": "aggregation", "robots": 2, "robot": robot, "seed": 3}
        episodes = _engine.Episodes(host, parameters, [3])
        for _ in range(steps):
            episodes.step(np.zeros((2, 2), np.float32))
        return episodes.acting()[2][:, :8]

    assert np.array_equal(sensed("Floating", 0), sensed("Sees", 0))
    seen = sensed("Sees", 1)
    assert (seen > 0).all()
    assert (seen == seen[0, 0]).all()
    assert not np.array_equal(seen, sensed("Floating", 1))


@pytest.mark.slow
def test_a_controller_is_simulated(tmp_path: Path) -> None:
    run = optimize(experiment(), out=tmp_path / "run")
    assert np.isfinite(simulate(run.experiment, run.best.controller))


def test_boxes_stand_behind_the_faces_of_walls() -> None:
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
    world = World(0.1, 0.5, [Wall(square, 0.3), Wall(square / np.float32(4), 0.2)], [], [], [], [], [])
    boxes = world.wall_boxes(0.1)
    places = [(0, -1.05), (1.05, 0), (0, 1.05), (-1.05, 0), (0, -0.2), (0.2, 0), (0, 0.2), (-0.2, 0)]
    assert np.array([(box.x, box.y) for box in boxes]) == pytest.approx(np.array(places))
    sizes = [(2, 0.1, 0.3)] * 4 + [(0.5, 0.1, 0.2)] * 4
    assert np.array([(box.length, box.thickness, box.height) for box in boxes]) == pytest.approx(
        np.array(sizes)
    )
