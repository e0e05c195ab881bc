"""Missions of the arena in a world of the user in Gazebo: one record, and mistakes in files."""

import shutil
import signal
import tempfile
from pathlib import Path

import pytest

from tests.gazebo.machine import EXPERIMENT, PROJECT, YARD, Launch, Serve
from tests.system.brokers import BrokerProcess
from tests.system.processes import Program
from tests.system.runs import attempts, record

pytestmark = pytest.mark.timeout(200)

MISSION = """title: Yard
walls: {rectangle: [3, 2]}
start: {rectangle: {x: [-0.4, 0.4], y: [-0.3, 0.3]}}
metrics:
  covered: {kind: covered_share, radius: 0.25, when: end}
fitness: covered
"""
IN_THE_YARD = EXPERIMENT.replace("mission: aggregation", "mission: yard.yaml").replace(
    "duration: 4", "duration: 2"
)


def yard(
    launch: Launch, url: str, folder: Path, name: str, more: str = "", mission: str = MISSION
) -> Program:
    """Start a run in the yard whose results go to `folder / name`."""
    (folder / "yard.yaml").write_text(mission)
    path = folder / f"{name}.yaml"
    path.write_text(IN_THE_YARD + more)
    return launch("optimize", path, "--broker", url, "--out", name)


def test_all_modes_and_two_servers_one_of_which_is_killed_have_one_record(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    first = serve(broker.url, "--world", YARD, server=1)
    for mode in ("offloaded", "stepwise", "batched"):
        program = yard(launch, broker.url, tmp_path, mode, f"mode: {mode}\n")
        assert program.wait(150) == 0, program.stderr
    expected = record(tmp_path / "offloaded")
    assert record(tmp_path / "stepwise") == record(tmp_path / "batched") == expected

    second = serve(broker.url, "--world", YARD, server=2)
    program = yard(launch, broker.url, tmp_path, "two", "mode: stepwise\n")
    second.until(lambda one: "busy" in one.stderr, "second server at work")
    second.signal(signal.SIGKILL)
    assert second.process.wait(10) == -signal.SIGKILL
    assert program.wait(150) == 0, program.stderr
    assert record(tmp_path / "two") == expected
    assert any(attempt["server"] == 1 for attempt in attempts(tmp_path / "two"))
    assert first.process.poll() is None


def test_the_script_finds_files_anywhere(
    broker: BrokerProcess, launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The Debian with Gazebo has this machine's /tmp, but not its /var/tmp.
    with (
        tempfile.TemporaryDirectory(dir="/var/tmp") as world,
        tempfile.TemporaryDirectory(dir="/var/tmp") as models,
    ):
        shutil.copy(YARD, world)
        shutil.copytree(YARD.parent / "crate", Path(models) / "crate")
        monkeypatch.setenv("GAZEBO_MODEL_PATH", models)
        script = str(PROJECT / "swarmwright-gazebo")
        option = f"--world={world}/{YARD.name}"
        server = Program(script, "--broker", broker.url, "--id", 1, option, cwd=tmp_path, program=())
        try:
            server.until_error("ready", 60)
            program = yard(launch, broker.url, tmp_path, "anywhere")
            assert program.wait(100) == 0, program.stderr
        finally:
            server.stop()


def test_robots_that_begin_in_something(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    server = serve(broker.url, "--world", YARD)
    mission = MISSION.replace("x: [-0.4, 0.4], y: [-0.3, 0.3]", "x: [-0.1, 0.1], y: [-0.6, -0.4]")
    program = yard(launch, broker.url, tmp_path, "column", mission=mission)
    assert program.wait(100) != 0
    assert "mission: robot 0 begins at x = " in program.stderr
    assert f'in the model "column" of {YARD}: move that away' in program.stderr
    assert server.process.poll() is None


def world(text: str) -> str:
    return f"<sdf version='1.6'><world name='w'>{text}</world></sdf>"


FLOOR = "<include><uri>model://ground_plane</uri></include>"
HEAVY = "<model name='m'><link name='l'><inertial><mass>heavy</mass></inertial></link></model>"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<sdf version='1.6'>\n<world name='w'>\n</sdf>", ":2: not valid XML (ERROR_MISMATCHED_ELEMENT)"),
        ("", ":1: not valid XML (ERROR_EMPTY_DOCUMENT)"),
        ("<robot name='r'/>", ":1: <robot> found, expected <sdf>: the file is not SDF"),
        ("<sdf version='1.6'><model name='m'/></sdf>", ":1: <sdf> without <world>"),
        (
            "<sdf version='1.6'><world name='a'/>\n<world name='b'/></sdf>",
            ":2: a second <world> found, expected one",
        ),
        ("<sdf><world name='a'/></sdf>", ':1: <sdf> without its version, such as version="1.6"'),
        (
            world(f"{FLOOR}\n<include><uri> model://shed\n</uri></include>"),
            ':2: <include> of "model://shed": not found; put it beside the file',
        ),
        (
            world("<include><uri>https://fuel.org/shed</uri></include>"),
            ':1: <include> of "https://fuel.org/shed": not found; nothing is fetched from the network',
        ),
        (
            world("<include><uri>model://broken</uri></include>"),
            'broken/model.sdf:2: <mesh> of "model://broken/shed.dae": not found',
        ),
        (
            world("<include><uri>model://empty</uri></include>"),
            ':1: <include> of "model://empty": its folder has no model.config',
        ),
        (
            world("\n<physics type='havok'/>"),
            ':2: <physics type="havok">: expected ode, the only engine here',
        ),
        (
            world("<model name='robot_1'><link name='l'/></model>"),
            'wrong.world: <model name="robot_1">: missions call their own models so; rename it',
        ),
        (world(HEAVY), "wrong.world: Invalid argument. Unable to set value [heavy ] for key[mass]"),
    ],
)
def test_worlds_that_cannot_be_used(text: str, message: str, serve: Serve, tmp_path: Path) -> None:
    (tmp_path / "wrong.world").write_text(text)
    (tmp_path / "empty").mkdir()
    broken = tmp_path / "models" / "broken"
    broken.mkdir(parents=True)
    shutil.copy(YARD.parent / "crate" / "model.config", broken)
    (broken / "model.sdf").write_text(
        "<sdf version='1.6'><model name='m'><link name='l'><visual name='v'><geometry><mesh>\n"
        "<uri>model://broken/shed.dae</uri></mesh></geometry></visual></link></model></sdf>"
    )
    server = serve("mqtt://localhost:1", "--world", "wrong.world", wait=False)
    assert server.wait(60) == 1
    assert message in server.stderr
    assert server.stderr.startswith("error: ")
    assert len(server.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--world", "missing.world"], 1, "error: missing.world: no such file, or it cannot be read"),
        (["--world", "."], 1, "error: .: a folder found, expected a file in SDF"),
        (["--world", YARD, "--walls", "none"], 2, '--walls: "none" found, expected mission or world'),
        (["--title", "yard"], 2, '--title: "yard" found, expected arena-NAME'),
        (["--walls", "world"], 2, "--walls world: expected --world FILE, too"),
    ],
)
def test_wrong_options(options: list[str], status: int, message: str, serve: Serve) -> None:
    server = serve("mqtt://localhost:1", *options, wait=False)
    assert server.wait(60) == status
    assert message in server.stderr


def test_a_world_without_a_floor(broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path) -> None:
    path = tmp_path / "empty.world"
    path.write_text(world(""))
    serve(broker.url, "--world", path)
    program = yard(launch, broker.url, tmp_path, "fallen")
    assert program.wait(100) != 0
    assert f"{path} has no floor there, at z = 0" in program.stderr
