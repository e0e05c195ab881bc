"""Missions of the arena with models of the user in Gazebo: SDF, URDF, xacro; and mistakes in them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.gazebo.machine import E_PUCK, EXPERIMENT, PROJECT, SCANNER, XACRO, YARD, Launch, Serve, command
from tests.system.brokers import BrokerProcess
from tests.system.processes import Program
from tests.system.runs import record

pytestmark = pytest.mark.timeout(300)

PROGRAMS = Path(sys.executable).parent
WHEELS = ["--joints", "wheel_left_joint,wheel_right_joint"]
LIKE_TURTLEBOT3 = EXPERIMENT.replace(
    "mission: aggregation, robots: 4, duration: 4",
    "mission: room.yaml, robot: turtlebot3, robots: 2, duration: 2",
)
ROOM = """title: Room
walls: {rectangle: [3, 3]}
start: {rectangle: {x: [-1, 1], y: [-0.3, 0.3]}}
metrics:
  covered: {kind: covered_share, radius: 0.25, when: end}
fitness: covered
"""


def expanded(folder: Path) -> Path:
    """The model in xacro as URDF."""
    path = folder / "two_wheels.urdf"
    path.write_bytes(subprocess.check_output([PROGRAMS / "xacro", XACRO], timeout=30))
    return path


def room(launch: Launch, url: str, folder: Path, name: str, change: tuple[str, str] = ("", "")) -> Program:
    (folder / "room.yaml").write_text(ROOM)
    path = folder / f"{name}.yaml"
    path.write_text(LIKE_TURTLEBOT3.replace(*change))
    return launch("optimize", path, "--broker", url, "--out", name)


@pytest.mark.parametrize("model", ["e_puck", "turtlebot3", "scanner", "urdf"])
def test_motion_rays_repetition_and_memory(model: str, tmp_path: Path) -> None:
    wheels = ["wheel_left_joint", "wheel_right_joint"]
    arguments: dict[str, list[str | Path]] = {
        "e_puck": ["e_puck", E_PUCK, "left_joint", "right_joint"],
        "turtlebot3": ["turtlebot3", SCANNER, *wheels],
        "scanner": ["turtlebot3", SCANNER, *wheels, "scanner"],
        "urdf": ["turtlebot3", tmp_path / "two_wheels.urdf", "left_wheel_joint", "right_wheel_joint"],
    }
    if model == "urdf":
        expanded(tmp_path)
    done = subprocess.run(
        [*command("test_physics"), *arguments[model]],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_two_servers_have_one_record(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    serve(broker.url, "--model", SCANNER, *WHEELS, "--sensor", "scanner", server=1)
    program = room(launch, broker.url, tmp_path, "one")
    assert program.wait(200) == 0, program.stderr
    serve(broker.url, "--model", SCANNER, *WHEELS, "--sensor", "scanner", server=2)
    program = room(launch, broker.url, tmp_path, "two")
    assert program.wait(200) == 0, program.stderr
    assert record(tmp_path / "one") == record(tmp_path / "two")


def test_the_script_expands_xacro(
    broker: BrokerProcess, launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", f"{PROGRAMS}:{os.environ['PATH']}")
    script = str(PROJECT / "swarmwright-gazebo")
    options = ["--broker", broker.url, "--id", "1", "--joints", "left_wheel_joint,right_wheel_joint"]
    server = Program(script, *options, "--model", XACRO, cwd=tmp_path, program=())
    try:
        server.until_error("ready", 60)
        program = room(launch, broker.url, tmp_path, "xacro")
        assert program.wait(200) == 0, program.stderr
    finally:
        server.stop()

    wrong = tmp_path / "wrong.xacro"
    wrong.write_text(XACRO.read_text().replace("${base / 2}", "${width / 2}"))
    server = Program(script, *options, f"--model={wrong}", cwd=tmp_path, program=())
    assert server.wait(60) == 1
    assert server.stderr.startswith(f"error: {wrong}: xacro: ")
    assert "name 'width' is not defined" in server.stderr
    assert len(server.stderr.splitlines()) == 1

    (tmp_path / "bin").mkdir()
    for tool in ("bash", "dirname", "readlink", "realpath"):
        found = shutil.which(tool)
        assert found is not None
        (tmp_path / "bin" / tool).symlink_to(found)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("SWARMWRIGHT_GAZEBO", os.environ["SWARMWRIGHT_GAZEBO"])
    server = Program(script, *options, "--model", XACRO, cwd=tmp_path, program=())
    assert server.wait(60) == 1
    assert server.stderr == f"error: {XACRO}: xacro is not on the path; pip install xacro"


def model(text: str) -> str:
    return f"<sdf version='1.6'><model name='m'>{text}</model></sdf>"


LINKS = "".join(
    f"<link name='{name}'><pose>0 {y} 0.05 0 0 0</pose>"
    "<collision name='c'><geometry><sphere><radius>0.05</radius></sphere></geometry></collision></link>"
    for name, y in (("a", 0), ("b", 0.1), ("c", -0.1))
)


def joints(first: str = "revolute", axis: str = "0 1 0", child: str = "b") -> str:
    return "".join(
        f"<joint name='{name}' type='{kind}'><parent>a</parent><child>{link}</child>"
        f"<axis><xyz>{axis}</xyz></axis></joint>"
        for name, kind, link in (("l", first, child), ("r", "revolute", "c"))
    )


RAY = "<link name='s'><sensor name='camera' type='camera'/></link>"


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("<sdf version='1.6'>\n<model>\n</sdf>", [], "wrong.sdf:2: not valid XML"),
        ("<world/>", [], "wrong.sdf:1: <world> found, expected <sdf>, or <robot> of URDF"),
        ("<sdf version='1.6'><world name='w'/></sdf>", [], "wrong.sdf:1: <sdf> without <model>"),
        (
            "<sdf version='1.6'><model name='m'/>\n<model name='n'/></sdf>",
            [],
            "wrong.sdf:2: a second <model> found, expected one",
        ),
        ("<robot name='r'/>", [], "wrong.sdf: "),
        ("<robot name='r'>\n<xacro:wheel/></robot>", [], "wrong.sdf:2: <xacro:wheel>: this is xacro"),
        (
            "<robot name='r'><link name='a'><visual>\n<mesh filename='package://some/a.stl'/></visual></link></robot>",
            [],
            'wrong.sdf:2: <mesh> of "package://some/a.stl": not found',
        ),
        (model(LINKS), [], 'wrong.sdf: no joint "l", which --joints names; the model has none'),
        (model(LINKS + joints("prismatic")), [], '<joint name="l">: type prismatic found, expected revolute'),
        (
            model(LINKS + joints(axis="1 0 0")),
            [],
            '<joint name="l">: its axis is 1 0 0 in the frame of the model',
        ),
        (
            model("<static>1</static>" + LINKS + joints()),
            [],
            "wrong.sdf: <static>: the model cannot move; remove it",
        ),
        (
            model(LINKS + "<link name='d'/>" + joints(child="d")),
            [],
            '<joint name="l">: its child has no <collision>',
        ),
        (
            model(LINKS + joints()),
            ["--joints", "r,l"],
            '<joint name="r"> is to the right of "l" for a robot that looks along x',
        ),
        (
            model(LINKS + joints()),
            ["--sensor", "eye"],
            'no sensor "eye", which --sensor names; the model has none',
        ),
        (
            model(LINKS + RAY + joints()),
            ["--sensor", "camera"],
            '<sensor name="camera">: type camera found, expected ray',
        ),
    ],
)
def test_models_that_cannot_be_used(
    text: str, options: list[str], message: str, serve: Serve, tmp_path: Path
) -> None:
    (tmp_path / "wrong.sdf").write_text(text)
    if "--joints" not in options:
        options = ["--joints", "l,r", *options]
    server = serve("mqtt://localhost:1", "--model", "wrong.sdf", *options, wait=False)
    assert server.wait(60) == 1
    assert message in server.stderr
    assert server.stderr.startswith("error: ")


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--model", "missing.sdf", "--joints", "l,r"], 1, "error: missing.sdf: no such file"),
        (["--model", "robot.xacro", "--joints", "l,r"], 1, "robot.xacro: xacro has to expand it first"),
        (["--model", SCANNER], 2, "--model FILE and --joints LEFT,RIGHT: expected both or none"),
        (["--model", SCANNER, "--joints", "wheel"], 2, '--joints: "wheel" found, expected LEFT,RIGHT'),
        (["--sensor", "scanner"], 2, "--sensor: expected --model FILE, too"),
        (["--model", SCANNER, *WHEELS, "--drive", "body"], 2, "--drive body: a --model drives by its wheels"),
    ],
)
def test_wrong_options(options: list[str], status: int, message: str, serve: Serve) -> None:
    server = serve("mqtt://localhost:1", *options, wait=False)
    assert server.wait(60) == status
    assert message in server.stderr


@pytest.mark.parametrize(
    ("old", "new", "change", "message"),
    [
        (
            "",
            "",
            ("robot: turtlebot3, ", ""),
            "these wheels are 0.16 m apart, those of the mission's robot 0.053 m",
        ),
        (
            "<axis><xyz>0 0 1</xyz></axis>",
            "<axis><xyz>0 0 1</xyz><limit><velocity>3</velocity></limit></axis>",
            ("", ""),
            "<limit><velocity> allows 0.099 m/s, the mission's robot drives 0.22 m/s",
        ),
        (
            "<max_angle>6.265732</max_angle>",
            "<max_angle>1.57</max_angle>",
            ("", ""),
            '<sensor name="scanner">: it has no ray at ',
        ),
        ("<max>3.7</max>", "<max>1</max>", ("", ""), '<sensor name="scanner">: it reaches 1 m'),
    ],
)
def test_missions_that_contradict_the_model(
    old: str,
    new: str,
    change: tuple[str, str],
    message: str,
    broker: BrokerProcess,
    serve: Serve,
    launch: Launch,
    tmp_path: Path,
) -> None:
    path = tmp_path / "robot.sdf"
    path.write_text(SCANNER.read_text().replace(old, new))
    server = serve(broker.url, "--model", path, *WHEELS, "--sensor", "scanner")
    program = room(launch, broker.url, tmp_path, "wrong", change)
    assert program.wait(100) != 0
    assert f"robot: {path}: " in program.stderr
    assert message in program.stderr
    assert server.process.poll() is None


def test_a_model_in_a_world(broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path) -> None:
    serve(broker.url, "--model", SCANNER, *WHEELS, "--world", YARD)
    program = room(launch, broker.url, tmp_path, "both")
    assert program.wait(200) == 0, program.stderr
