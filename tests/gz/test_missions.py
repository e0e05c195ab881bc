"""Missions of the arena in Gazebo Fortress: worlds and models of the user, a server that dies, mistakes."""

import shlex
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from swarmwright import Run
from swarmwright.conformance import check_server
from tests.gazebo.machine import E_PUCK, FORTRESS, SCANNER, YARD, Launch, Serve, optimize
from tests.system.brokers import BrokerProcess
from tests.system.runs import attempts, record

pytestmark = pytest.mark.timeout(300)

GROUND = """<model name="ground"><static>true</static><link name="link"><collision name="collision">
<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry></collision></link></model>"""
PHYSICS = '<plugin filename="gz-sim-physics-system" name="gz::sim::systems::Physics"/>'
WHEELS = ["--joints", "wheel_left_joint,wheel_right_joint"]


def yard(folder: Path) -> Path:
    """The world of the tests with Gazebo classic, whose own models Fortress does not have."""
    text = YARD.read_text()
    for name in ("ground_plane", "sun"):
        include = f"<include>\n      <uri>model://{name}</uri>\n    </include>"
        assert include in text
        text = text.replace(include, GROUND + PHYSICS if name == "ground_plane" else "")
    shutil.copytree(YARD.parent / "crate", folder / "crate")
    path = folder / "yard.sdf"
    path.write_text(text)
    return path


@pytest.mark.parametrize("option", ["wheels", "body", "yard", "e_puck", "turtlebot3", "scanner"])
def test_motion_walls_rays_objects_repetition_and_memory(option: str, tmp_path: Path) -> None:
    arguments: dict[str, list[str | Path]] = {
        "e_puck": ["e_puck", E_PUCK, "left_joint", "right_joint"],
        "turtlebot3": ["turtlebot3", SCANNER, "wheel_left_joint", "wheel_right_joint"],
        "scanner": ["turtlebot3", SCANNER, "wheel_left_joint", "wheel_right_joint", "scanner"],
    }
    own = [yard(tmp_path)] if option == "yard" else arguments.get(option, [option])
    done = subprocess.run(
        [*FORTRESS.command("test_physics"), *map(str, own)],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_all_modes_and_two_servers_one_of_which_is_killed_have_one_record(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    first = serve(broker.url, server=1)
    for mode in ("offloaded", "stepwise", "batched"):
        program = optimize(launch, broker.url, tmp_path, mode, f"mode: {mode}\n", FORTRESS)
        assert program.wait(150) == 0, program.stderr
    expected = record(tmp_path / "offloaded")
    assert record(tmp_path / "stepwise") == record(tmp_path / "batched") == expected

    second = serve(broker.url, server=2)
    program = optimize(launch, broker.url, tmp_path, "two", "mode: stepwise\n", FORTRESS)
    second.until(lambda one: "busy" in one.stderr, "second server at work")
    second.signal(signal.SIGKILL)
    assert second.process.wait(10) == -signal.SIGKILL
    assert program.wait(150) == 0, program.stderr
    assert record(tmp_path / "two") == expected
    assert any(attempt["server"] == 1 for attempt in attempts(tmp_path / "two"))
    assert first.process.poll() is None


def test_the_conformance_kit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    server = shlex.join(FORTRESS.command(FORTRESS.server))
    report = check_server(
        command=f"{server} --broker {{broker}} --id {{id}} --step-timeout 1",
        parameters={"mission": "aac", "robot": "e-puck-rm1.2", "robots": 3, "duration": 2},
        step_timeout=1,
        rules=["-S6.5,-S6.9,-S6.13,-S11.2,-S12,-S16"],
        sensors=9,
        actuators=2,
    )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == {"S8.1", "S8.2", "S9.7", "S9.14"}


def test_a_model_in_a_world(broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path) -> None:
    world = yard(tmp_path)
    server = serve(
        broker.url,
        "--world",
        world,
        "--model",
        SCANNER,
        *WHEELS,
        "--sensor",
        "scanner",
        "--title",
        "arena-yard",
    )
    (tmp_path / "yard.yaml").write_text(
        "title: Yard\nwalls: {rectangle: [3, 2]}\n"
        "start: {rectangle: {x: [-0.4, 0.4], y: [-0.3, 0.3]}}\n"
        "metrics:\n  covered: {kind: covered_share, radius: 0.25, when: end}\nfitness: covered\n"
    )
    path = tmp_path / "both.yaml"
    path.write_text(
        FORTRESS.experiment()
        .replace("arena-gz", "arena-yard")
        .replace(
            "mission: aggregation, robots: 4, duration: 4",
            "mission: yard.yaml, robot: turtlebot3, robots: 2, duration: 2",
        )
    )
    program = launch("optimize", path, "--broker", broker.url, "--out", "both")
    assert program.wait(200) == 0, program.stderr
    assert "busy" in server.stderr, "this server evaluated, and no other"
    best = Run.open(tmp_path / "both").best
    assert 0 < best.fitness <= 1, "robots cover where they stand"


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--step", "1"], 2, "--step: 1 found, expected seconds from 0.0001 to 0.1"),
        (["--master-port", "11345"], 2, "--master-port: unknown"),
        (["--world", "missing.sdf"], 1, "error: missing.sdf: no such file, or it cannot be read"),
        (["--world", "broken.sdf"], 1, "broken.sdf:2: not valid XML (ERROR_MISMATCHED_ELEMENT)"),
        (["--world", "fuel.sdf"], 1, "not found; nothing is fetched from the network"),
        (["--world", "other.sdf"], 1, '<physics type="havok">: expected dart, ode or ignored'),
        (["--model", "box.sdf", "--joints", "l,r"], 1, 'box.sdf: no joint "l", which --joints names'),
        (["--model", SCANNER, *WHEELS, "--sensor", "eye"], 1, 'no sensor "eye", which --sensor names'),
        ([], 1, "localhost:1"),
    ],
)  # fmt: skip
def test_wrong_arguments(options: list[str], status: int, message: str, serve: Serve, tmp_path: Path) -> None:
    world = "<sdf version='1.6'><world name='w'>{}</world></sdf>"
    (tmp_path / "broken.sdf").write_text("<sdf version='1.6'>\n<world name='w'>\n</sdf>")
    (tmp_path / "fuel.sdf").write_text(world.format("<include><uri>https://fuel.org/shed</uri></include>"))
    (tmp_path / "other.sdf").write_text(world.format("<physics type='havok'/>"))
    (tmp_path / "box.sdf").write_text("<sdf version='1.6'><model name='m'><link name='l'/></model></sdf>")
    server = serve("mqtt://localhost:1", *options, wait=False)
    assert server.wait(60) == status
    assert message in server.stderr
    assert len(server.stderr.splitlines()) < 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("robots: 2000", "parameters.robots: 2000 robots do not fit into their start region"),
        ("mission: nowhere.yaml", "nowhere.yaml: there is no such file"),
    ],
)
def test_a_mission_that_cannot_be(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path, change: str, message: str
) -> None:
    server = serve(broker.url)
    name, _, _ = change.partition(":")
    old = {"robots": "robots: 4", "mission": "mission: aggregation"}[name]
    path = tmp_path / "wrong.yaml"
    path.write_text(FORTRESS.experiment().replace(old, change))
    program = launch("optimize", path, "--broker", broker.url, "--out", "wrong")
    assert program.wait(60) != 0
    assert message in program.stderr
    assert server.process.poll() is None


def test_a_crash_in_an_episode_is_reported(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    server = serve(broker.url)
    program = optimize(launch, broker.url, tmp_path, "crash", "timeouts: {discovery: 3, step: 5}\n", FORTRESS)
    server.until(lambda one: "busy" in one.stderr, "server at work")
    server.signal(signal.SIGSEGV)
    assert server.process.wait(10) == -signal.SIGSEGV
    assert program.wait(100) != 0
    assert "no server" in program.stderr, "it was the only one"
    again = serve(broker.url, server=3)
    again.signal(signal.SIGTERM)
    assert again.wait(10) == 0
