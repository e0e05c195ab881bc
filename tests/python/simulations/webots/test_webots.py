"""Robots in Webots: controllers in processes of their own against a module and a simulator that stand in."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, RunError, optimize, simulate
from swarmwright.simulations import webots
from swarmwright.simulations.attachment import Attachment, AttachmentError, Episodes
from tests.python.records import same_record

pytestmark = pytest.mark.slow

SIMULATOR = Path(__file__).with_name("simulator.py")
HOME = Path(__file__).with_name("home")
START = f"start: [{sys.executable}, {SIMULATOR}, '--port={{port}}']\n"
ROBOTS = """\
robots: [rover, rover(1)]
sensors:
  - {sensor: wall, device: ds, scale: -1, offset: 1}
  - {sensor: y, device: gps, kind: values, index: 1}
actuators:
  - {actuator: left, device: left wheel motor, scale: 10, limits: [-5, 10]}
  - {actuator: right, device: right wheel motor, scale: 10}
ticks: 2
steps: 20
metrics:
  x: {pose: x}
  furthest: {pose: x, robots: max, time: max}
  near: {sensor: wall, time: max, robots: sum}
"""


@pytest.fixture(autouse=True)
def home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WEBOTS_HOME", str(HOME))


@contextmanager
def started(text: str, folder: Path) -> Iterator[tuple[webots.Webots, Episodes]]:
    (folder / "robots.yaml").write_text(text + START)
    attachment = Attachment.read(folder / "robots.yaml")
    simulator = webots.Webots(attachment)
    try:
        yield simulator, Episodes(attachment, simulator)
    finally:
        simulator.close()


def test_robots_drive_sense_and_start_again(tmp_path: Path) -> None:
    with started(ROBOTS, tmp_path) as (_, robots):
        first = robots.reset(1)
        assert first == {"sensors": [[0, 1], [0, -1]]}
        for _ in range(11):  # 1 m/s for 0.1 s each, against limits of 0.5 m/s to the rear
            answer = robots.step([[1, 1], [-1, -0.5]])
        assert answer["sensors"] == [pytest.approx([0.1, 1]), [0, -1]]
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


def test_robots_start_where_the_seed_says(tmp_path: Path) -> None:
    with started(ROBOTS + "area: {x: [-1, 1], y: [-1, 1]}\napart: 0.5\n", tmp_path) as (simulator, robots):
        found = []
        for seed in (1, 2, 1):
            robots.reset(seed)
            poses = simulator.poses()
            assert [pose.z for pose in poses] == [0.05, 0.05]  # as in the world
            found.append([(pose.x, pose.y, pose.yaw) for pose in poses])
    assert found[0] == found[2] != found[1]
    (x, y, _), (a, b, _) = found[0]
    assert np.hypot(x - a, y - b) >= 0.5


def experiment(folder: Path, text: str = ROBOTS) -> Experiment:
    (folder / "robots.yaml").write_text(text + ("" if "start:" in text else START))
    (folder / "webots.yaml").write_text(
        "simulation:\n"
        f"  command: [{sys.executable}, -m, swarmwright.simulations.webots, robots.yaml]\n"
        "  controller: stepwise\n  sensors: 2\n  actuators: 2\n  metrics: {x: last, near: last}\n"
        "fitness: x - near\ncontroller: {kind: layered, hidden: []}\n"
        "method: {population: 4, generations: 2}\n"
    )
    return Experiment.load(folder / "webots.yaml")


def test_one_record_on_one_server_and_on_two_and_nothing_left(tmp_path: Path) -> None:
    text = ROBOTS + "area: {x: [-1, 1], y: [-1, 1]}\n"
    one = optimize(experiment(tmp_path, text), servers=1, out=tmp_path / "one")
    same_record(optimize(experiment(tmp_path, text), servers=2, out=tmp_path / "two"), one)
    processes = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert str(tmp_path) not in processes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("device: ds", "device: ds9"), "rover.*: it has no device 'ds9'"),
        (("device: ds,", "device: ds, kind: sonar,"), r"'sonar' found, expected value, values, range_image"),
        (("scale: 10}", "scale: 20}"), "rover.*: ValueError: setVelocity: more than maxVelocity"),
        (("steps: 20", "start: ['false']\nsteps: 2"), r"start: false has ended \(status 1\)"),
        (
            ("steps: 20", f"{START.replace(']', ', 9]')}steps: 20"),
            r"start: .*python.* has ended \(status 3\)",
        ),
        (("robots: [rover, rover(1)]", "robots: [rover]"), "did not answer for 4 s"),
        (("rover(1)", "truck"), r'truck.*: Webots did not answer for 4 s; .* controller "<extern>"'),
    ],
)
def test_mistakes(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    text = ROBOTS.replace(*change)
    assert text != ROBOTS
    silent = "startup: 4\npatience: 4\n" if "did not answer" in words else ""
    one = experiment(tmp_path, text + silent)
    with pytest.raises(RunError, match=words):
        simulate(one, servers="in-process")


def test_where_webots_is_not_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WEBOTS_HOME")
    with (
        pytest.raises(AttachmentError, match="Python has no module 'controller'; set WEBOTS_HOME"),
        started(ROBOTS, tmp_path),
    ):
        pass
