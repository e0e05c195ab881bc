"""Rovers and quadrotors in MuJoCo: they drive and fly as they are told, sense what is there, and repeat."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from swarmwright import Experiment, InputError, optimize, simulate
from swarmwright.runs import mujoco_film as film
from swarmwright.simulations.host import describe
from swarmwright.simulations.mujoco import Quadrotors, Rovers
from swarmwright.simulations.mujoco._robots import Arena
from tests.python.records import same_record

QUARTER = np.pi / 2


def started(kind: type[Any], seed: int = 1, **parameters: Any) -> Any:
    simulation = kind()
    defaults = {name: one.default for name, one in kind.parameters.items()}
    simulation.reset({**defaults, **parameters}, seed)
    return simulation


def put(simulation: Any, *places: tuple[float, float, float]) -> Any:
    """Put robots at x, y, heading; return what they sense."""
    rows = np.array(places)
    simulation.start(rows[:, :2], rows[:, 2])
    mujoco.mj_forward(simulation.model, simulation.data)
    simulation.prepare()
    return simulation.look()


def go(simulation: Any, *action: float, steps: int = 10) -> Any:
    row = np.array(action, np.float32).reshape(-1, simulation.actuators)
    actions = np.ascontiguousarray(np.broadcast_to(row, (simulation.agents, simulation.actuators)))
    for _ in range(steps):
        seen = simulation.step(actions)
    return seen


def test_a_rover_drives_and_turns() -> None:
    rover = started(Rovers, agents=1, arena={"width": 10, "depth": 10})
    put(rover, (0, 0, 0))
    seen = go(rover, 1, 1, steps=40)
    x, y, z = rover.positions()[0]
    assert 1.5 < x < 2.0  # 4 s, not quite at 0.5 m/s from the start
    assert abs(y) < 0.1
    assert z == pytest.approx(0.05, abs=0.005)
    assert 0.7 < seen[0, 11] < 1.2
    put(rover, (0, 0, 0))
    go(rover, -1, 1, steps=3)
    heading = np.arctan2(*rover.frames()[0, 1::-1, 0])
    assert 0.3 < heading < np.pi  # counterclockwise
    assert abs(rover.positions()[0, :2]).max() < 0.05


def test_range_sensors_see_walls_pillars_and_others() -> None:
    arena = {"width": 4, "depth": 6, "pillars": [[0, 1, 0.2]]}
    rovers = started(Rovers, agents=2, arena=arena, range=2.0)
    seen = put(rovers, (0, 0, 0), (1.5, -2.5, QUARTER))
    readings = seen[0, :8]
    assert readings[0] == pytest.approx(1 - (2 - 0.12) / 2, abs=0.02)  # the wall ahead
    assert readings[2] == pytest.approx(1 - (0.8 - 0.12) / 2, abs=0.02)  # the pillar to the left
    assert readings[6] == 0  # the wall behind the range
    seen = put(rovers, (0, -1, 0), (1, -1, np.pi))
    assert seen[0, 0] == pytest.approx(1 - (0.9 - 0.12) / 2, abs=0.03)
    # They look at each other, the middle is half-way.
    assert seen[:, 8:11] == pytest.approx(np.array([[1, 0, 0.5 / 6]] * 2), abs=1e-6)


def test_rovers_touch_and_are_held_by_a_wall() -> None:
    rover = started(Rovers, agents=1, arena={"width": 2, "depth": 2})
    put(rover, (0.5, 0, 0))
    go(rover, 1, 1, steps=30)
    assert rover.positions()[0, 0] == pytest.approx(0.9, abs=0.02)
    assert rover.touching().tolist() == [True]
    assert 0.3 < rover.measure()["touching"] < 1


def test_a_quadrotor_holds_height_and_velocity() -> None:
    quadrotor = started(Quadrotors, agents=1, arena={"width": 10, "depth": 10})
    put(quadrotor, (0, 0, 0))
    go(quadrotor, 0, 0, steps=20)
    assert quadrotor.positions()[0] == pytest.approx([0, 0, 1], abs=0.01)
    seen = go(quadrotor, 1, -0.5, steps=20)
    assert seen[0, 8:] == pytest.approx([1, -0.5], abs=0.05)
    assert quadrotor.positions()[0, 2] == pytest.approx(1, abs=0.05)
    assert quadrotor.measure()["crashed"] == 0


def test_a_quadrotor_that_touches_falls_and_is_out() -> None:
    quadrotors = started(Quadrotors, agents=3, arena={"width": 6, "depth": 6})
    put(quadrotors, (2, 2, 0), (-2, -2, 0), (0, 0, 0))
    actions = np.array([[1, 0], [0, 0], [0, 0]], np.float32)
    covered = quadrotors.measure()["covered"]
    for _ in range(30):
        quadrotors.step(actions)
    assert quadrotors.acting().tolist() == [False, True, True]
    assert quadrotors.positions()[0, 2] < 0.1
    assert quadrotors.measure() == {
        "crashed": 1,
        "covered": pytest.approx(covered * 2 / 3, rel=0.2),
        "closest": pytest.approx(8**0.5, abs=0.01),
    }
    states = [body.state for body in quadrotors.scene().find_bodies("agent")]
    assert states == ["crashed", "free", "free"]


def test_the_floor_that_is_seen() -> None:
    quadrotors = started(Quadrotors, agents=2, arena={"width": 10, "depth": 10}, view=1.0, steps=2)
    put(quadrotors, (-3, 0, 0), (3, 0, 0))
    go(quadrotors, 0, 0, steps=2)
    assert quadrotors.fitness() == pytest.approx(2 * np.pi / 100, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Rovers, Quadrotors])
def test_one_record_here_and_on_servers_in_every_mode(kind: type[Any], tmp_path: Path) -> None:
    def experiment(mode: str) -> Experiment:
        return Experiment.from_mapping(
            {
                "simulation": kind,
                "parameters": {"agents": 3, "steps": 8, "pillars": 2},
                "controller": {"hidden": []},
                "method": {"population": 4, "generations": 1},
                "ranking": {"episodes": 2},
                "mode": mode,
            }
        )

    here = optimize(experiment("auto"), servers="in-process", out=tmp_path / "here")
    for mode, servers in (("batched", 1), ("offloaded", 2)):
        same_record(optimize(experiment(mode), servers=servers, out=tmp_path / mode), here)


def test_places_are_free_and_follow_from_the_seed() -> None:
    arena = Arena.read({"width": 5, "depth": 4, "pillars": [[1, 1, 0.5]]})
    pillars, robots = arena.draw_layout(np.random.default_rng(3), 4, 0.25, 10, 0.2, 1.0)
    assert (len(pillars), len(robots)) == (5, 10)
    every = np.vstack([pillars, robots])
    rooms = np.array([0.5] + [0.25] * 4 + [0.2] * 10)
    apart = np.hypot(*(every[:, None] - every[None]).transpose(2, 0, 1)) + 9 * np.eye(15)
    assert (apart >= rooms[:, None] + rooms[None] - 1e-9).all()
    again = arena.draw_layout(np.random.default_rng(3), 4, 0.25, 10, 0.2, 1.0)
    assert np.array_equal(again[1], robots)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"arena": {"widht": 3}}, "arena: 'widht' found, expected depth, height, pillars, width"),
        ({"arena": {"width": 0}}, "arena: width: 0 found, expected metres, from 0.5 to 100"),
        ({"arena": {"pillars": [[1, 1]]}}, r"arena: pillars: \[1, 1\] found, expected \[x, y, radius\]"),
        ({"arena": {"pillars": [[9, 1, 1]]}}, r"arena: pillars: \[9, 1, 1\] is outside"),
        ({"arena": {"width": 1, "depth": 1}}, "agents: the arena is too small for 6 of them"),
        ({"pillars": 100, "arena": {"width": 2}}, "pillars: the arena is too small for 100 of them"),
    ],
)
def test_arenas_that_cannot_be(parameters: dict[str, Any], words: str) -> None:
    one = Experiment.from_mapping({"simulation": Rovers, "parameters": parameters})
    with pytest.raises(InputError, match=words):
        simulate(one, servers="in-process")


def test_three_dimensions_are_announced() -> None:
    one = Experiment.from_mapping({"simulation": "swarmwright.simulations.mujoco:Quadrotors"})
    assert one.requirements is not None
    assert (one.requirements.dimensions, one.sensors, one.actuators) == (3, 10, 2)


NO_OSMESA = """
import ctypes

whole = ctypes.CDLL


class Lacking(whole):
    def __init__(self, name, *rest, **more):
        if "OSMesa" in str(name):
            raise OSError(f"{name}: cannot open shared object file")
        super().__init__(name, *rest, **more)


ctypes.CDLL = ctypes.cdll._dlltype = Lacking
"""


@pytest.mark.slow
@pytest.mark.parametrize("drawn_by", ["osmesa", "nothing", "disable"])
def test_a_film_where_nothing_can_be_drawn(tmp_path: Path, drawn_by: str) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "swarmwright.simulations.mujoco:Rovers",
            "parameters": {"steps": 3},
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "random_search", "population": 2, "generations": 1},
        }
    )
    optimize(experiment, servers="local", out=tmp_path / "run")
    (tmp_path / "sitecustomize.py").write_text(NO_OSMESA)
    environment = {**os.environ, "MUJOCO_GL": drawn_by, "PYTHONPATH": str(tmp_path)}
    process = subprocess.run(
        [sys.executable, "-m", "swarmwright.runs.mujoco_film", "run", "run.gif"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr.startswith(
        f"swarmwright: MuJoCo cannot draw on this machine (MUJOCO_GL={drawn_by}; "
    )
    assert "install OSMesa (Debian's package libosmesa6)" in process.stderr
    assert process.stderr.count("\n") == 1


@pytest.mark.slow
def test_what_cannot_be_filmed_is_refused_before_an_episode_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "swarmwright.simulations.mujoco:Rovers",
            "parameters": {"steps": 3},
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "random_search", "population": 2, "generations": 1},
        }
    )
    run = optimize(experiment, servers="local", out=tmp_path / "run")

    def simulated(*_: Any) -> None:
        raise AssertionError("an episode was simulated")

    monkeypatch.setattr(film, "render_frames", simulated)
    for arguments, words in (
        (["a.gif", "--episode", "9"], "episode: 9: "),
        (["a.xyz"], "a.xyz: the video is a GIF; choose a file name that ends with .gif"),
        (["a"], "a: the video is a GIF"),
    ):
        result = CliRunner().invoke(film.main, [str(run.path), *arguments])
        assert result.exit_code == 2
        assert result.output.startswith(f"swarmwright: {words}")
    with pytest.raises(InputError, match="have 1 episode\\(s\\); choose a number from 0 to 0"):
        film.write(run, tmp_path / "a.gif", episode=1)


class Lidar(Rovers):
    """One with a sensor more, whose names are not those of its base class."""

    sensors = Rovers.sensors + 1


def test_sensors_and_actuators_have_names_and_what_they_stand_for() -> None:
    rovers = describe(Rovers())
    assert (len(rovers.sensor_names), rovers.sensor_names[2]) == (12, "range 90 degrees")
    assert rovers.sensor_names[8:] == ("bearing cosine", "bearing sine", "distance", "speed")
    assert rovers.actuator_names == ("left wheel", "right wheel")
    assert rovers.actuator_ranges == ((-0.5, 0.5, "m/s"),) * 2
    assert (rovers.sensor_ranges[10], rovers.sensor_ranges[11]) == (None, (-0.5, 0.5, "m/s"))
    quadrotors = describe(Quadrotors())
    assert quadrotors.sensor_names[7:] == ("range 315 degrees", "velocity x", "velocity y")
    assert quadrotors.actuator_units == quadrotors.sensor_units[8:] == ("m/s", "m/s")
    own = describe(Lidar())
    assert (own.sensor_names, own.sensor_ranges) == ((), ())
    assert own.actuator_names == rovers.actuator_names
