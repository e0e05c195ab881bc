"""Robots in CoppeliaSim: the published client against a server that stands in for it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, RunError, optimize, simulate
from swarmwright.simulations import attachment as _attached
from swarmwright.simulations import coppeliasim
from swarmwright.simulations.attachment import Attachment, AttachmentError, Episodes
from tests.python.records import same_record

SIMULATOR = Path(__file__).with_name("simulator.py")
START = f"start: [{sys.executable}, {SIMULATOR}, '{{port}}']\n"
ROBOTS = """\
robots: ["/rover[0]", "/rover[1]"]
sensors:
  - {sensor: wall, device: front, kind: proximity, infinite: 1, scale: -1, offset: 1}
  - {sensor: left, device: leftJoint, kind: joint_velocity, scale: 0.1}
actuators:
  - {actuator: left, device: leftJoint, scale: 10, limits: [-5, 10]}
  - {actuator: right, device: rightJoint, scale: 10}
ticks: 2
steps: 20
metrics:
  x: {pose: x}
  furthest: {pose: x, robots: max, time: max}
  near: {sensor: wall, time: max, robots: sum}
"""


def started(text: str, folder: Path) -> coppeliasim.CoppeliaSim:
    (folder / "robots.yaml").write_text(text + START)
    return coppeliasim.CoppeliaSim(Attachment.read(folder / "robots.yaml"))


@contextmanager
def episodes(text: str, folder: Path) -> Iterator[Episodes]:
    simulator = started(text, folder)
    try:
        yield Episodes(Attachment.read(folder / "robots.yaml"), simulator)
    finally:
        simulator.close()


@pytest.mark.slow
def test_robots_drive_sense_and_start_again(tmp_path: Path) -> None:
    with episodes(ROBOTS, tmp_path) as robots:
        first = robots.reset(1)
        assert first == {"sensors": [[0, 0], [0, 0]]}
        for _ in range(11):  # 1 m/s for 0.1 s each, against limits of 0.5 m/s to the rear
            answer = robots.step([[1, 1], [-1, -0.5]])
        assert answer["sensors"][0] == pytest.approx([0.1, 1])
        assert answer["sensors"][1] == pytest.approx([0, -0.5])
        for _ in range(9):
            answer = robots.step([[0, 0], [-1, -0.5]])
        assert answer == {
            "done": True,
            "metrics": {
                "x": pytest.approx(0.05),
                "furthest": pytest.approx(1.1),
                "near": pytest.approx(0.1),
            },
        }
        assert robots.reset(2) == first
        again = robots.step([[1, 1], [0, 0]])
        assert again["sensors"][0] == pytest.approx([0, 1])


@pytest.mark.slow
def test_robots_start_where_the_seed_says(tmp_path: Path) -> None:
    text = ROBOTS + "area: {x: [-1, 1], y: [-1, 1]}\napart: 0.5\n"
    simulator = started(text, tmp_path)
    robots = Episodes(Attachment.read(tmp_path / "robots.yaml"), simulator)
    found = []
    try:
        for seed in (1, 2, 1):
            robots.reset(seed)
            found.append([(pose.x, pose.y, pose.yaw) for pose in simulator.poses()])
    finally:
        simulator.close()
    assert found[0] == found[2] != found[1]
    (x, y, _), (a, b, _) = found[0]
    assert np.hypot(x - a, y - b) >= 0.5


def experiment(folder: Path, text: str = ROBOTS, start: bool = True, **options: Any) -> Experiment:
    (folder / "robots.yaml").write_text(text + (START if start else ""))
    (folder / "coppelia.yaml").write_text(
        "simulation:\n"
        f"  command: [{sys.executable}, -m, swarmwright.simulations.coppeliasim, robots.yaml]\n"
        "  controller: stepwise\n  sensors: 2\n  actuators: 2\n  metrics: {x: last, near: last}\n"
        "fitness: x - near\ncontroller: {kind: layered, hidden: []}\n"
        "method: {population: 4, generations: 2}\n"
    )
    return Experiment.load(folder / "coppelia.yaml", [f"{key}={value}" for key, value in options.items()])


@pytest.mark.slow
def test_one_record_on_one_server_and_on_two(tmp_path: Path) -> None:
    text = ROBOTS + "area: {x: [-1, 1], y: [-1, 1]}\n"
    one = optimize(experiment(tmp_path, text), servers=1, out=tmp_path / "one")
    same_record(optimize(experiment(tmp_path, text), servers=2, out=tmp_path / "two"), one)
    assert one.best.fitness > one.history[0].median


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("/rover[1]", "/rover[2]"), r"/rover\[2\]: the scene in CoppeliaSim has no such object"),
        (("device: front", "device: rear"), r"/rover\[0\]/rear: the scene in CoppeliaSim has no"),
        (("device: front", "device: leftJoint"), "CoppeliaSim reports: .*no proximity sensor"),
        (("kind: proximity", "kind: sonar"), r"sensors\[0\].kind: 'sonar' found, expected proximity,"),
        (("infinite: 1, ", ""), r"/rover\[0\]: sensor wall is nan, expected a finite number"),
        (("ticks: 2", "tocks: 2"), r"robots.yaml:8: tocks: "),
        (("steps: 20", "poses: [{x: 1}]"), "poses: 1 found, expected a pose for each of 2 robots"),
        (("{sensor: wall, time", "{sensor: wal, time"), "there is no sensor 'wal'; available: wall, left"),
        (("steps: 20", "area: {x: [0, 1], y: [0, 1]}\napart: 2"), "area: it is too small for 2 robots"),
        (("steps: 20", "start: [no-such-program]"), "start: no-such-program: No such file or directory"),
        (("steps: 20", "start: ['false']"), r"start: false has ended \(status 1\)"),
        (("steps: 20", START.replace("]", ", 9]")), r"start: .*python.* has ended \(status 3\)"),
    ],
)  # fmt: skip
def test_mistakes(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    text = ROBOTS.replace(*change)
    assert text != ROBOTS
    one = experiment(tmp_path, text, start="start" not in text)
    with pytest.raises(RunError, match=words):
        simulate(one, servers="in-process")


def test_where_no_simulator_answers(tmp_path: Path) -> None:
    (tmp_path / "robots.yaml").write_text(ROBOTS + "startup: 0.5\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coppeliasim, "PORT", _attached.free_port())
        with pytest.raises(
            AttachmentError, match=r"at localhost:\d+ did not answer for 0.5 s; is it running"
        ):
            coppeliasim.CoppeliaSim(Attachment.read(tmp_path / "robots.yaml"))


@pytest.mark.slow
def test_nothing_is_left_running(tmp_path: Path) -> None:
    optimize(experiment(tmp_path), servers=1, out=tmp_path / "run")
    processes = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert str(tmp_path) not in processes


def test_where_the_client_is_not_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "coppeliasim_zmqremoteapi_client", None)
    with pytest.raises(InputError, match=r"is not installed; pip install 'swarmwright\[coppeliasim\]'"):
        started(ROBOTS, tmp_path)
