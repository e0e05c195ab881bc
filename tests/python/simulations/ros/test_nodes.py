"""Exported nodes on the wire: a robot that another program plays publishes what it senses and gets commands.

With `SWARMWRIGHT_ROS2=/opt/ros/jazzy/setup.bash`, nodes and robots of ROS 2 take part, too.
"""

import math
import signal
import subprocess
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.python.simulations.ros.conversation import (
    assert_on_wheels,
    commands,
    computed,
    engine,
    expected_sensors,
    on_wheels,
    row,
    until,
)
from tests.python.simulations.ros.mistakes import IN_THE_FILE, IN_THE_TOPICS, MAPPING, RANGE, SCAN, changed
from tests.python.simulations.ros.network import SETUP, Package, Robot, environment, node

pytestmark = pytest.mark.timeout(120)
KINDS = ["dds", "dds+rclpy", "cpp", "python"] if SETUP else ["dds"]


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture
def robot(package: Package, kind: str) -> Iterator[Robot]:
    with Robot(package, rclpy=kind.endswith("+rclpy")) as running:
        yield running


def grown(robot: Robot, steps: int) -> bool:
    return len(robot.steps()) > steps


def assert_same(steps: Any, controller: Any) -> None:
    """The actuators have the bits that the engine's controller gives for the sensors."""
    np.testing.assert_array_equal(
        np.ascontiguousarray(steps[:, 7:]).view(np.uint32), computed(controller, steps[:, :7])
    )


@pytest.mark.journey
@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best-effort"])
def test_the_node_computes_what_the_engine_computes(
    kind: str, reliable: bool, robot: Robot, tmp_path: Path
) -> None:
    with node(kind, robot, MAPPING, tmp_path) as running:
        robot.record_all()
        for index in range(12):
            robot.publish(row(index), reliable)
            until(partial(grown, robot, len(robot.steps()) + 8))
        steps = robot.steps()
        # Every sensor had all its values, in their order, and no others: up to the last bit of a sum.
        wanted = np.array([expected_sensors(index) for index in range(12)])
        for number in range(7):
            column = steps[:, number]
            seen = [value for value, before in zip(column[1:], column, strict=False) if value != before]
            distinct = list(dict.fromkeys(wanted[:, number].tolist()))
            np.testing.assert_allclose([column[0], *seen], distinct, rtol=3e-7, err_msg=f"sensor {number}")
        # The same actuators as the engine's controller, which has the same state, in every step.
        assert_same(steps, engine())
        assert len(np.unique(steps[:, 7:], axis=0)) >= 12
        # Every command is that of a step, in their order; zeros before the first one.
        said = commands(steps[:, 7:])
        until(lambda: len(robot.steps()) > len(steps))
        given = [one for one in robot.driven() if one != (0.0, 0.0)]
        rest = iter(commands(robot.steps()[:, 7:]))
        assert all(one in rest for one in given)
        assert len(given) > len(said) / 2
        assert robot.recorded("gripper")[-1]["data"] in robot.steps()[:, 9].tolist()
        labels = robot.recorded("swarmwright_controller/steps")[-1]["layout"]["dim"]
        assert [(one["label"], one["size"], one["stride"]) for one in labels] == [
            ("sensors, actuators", 10, 10)
        ]
        assert running.process.poll() is None


@pytest.mark.slow
def test_wheels_are_a_command_and_a_sensor_may_be_random(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, changed(on_wheels), tmp_path):
        robot.record_all()
        for index in range(4):
            robot.publish(row(index))
            until(partial(grown, robot, len(robot.steps()) + 8))
        driven = robot.driven()
        until(partial(grown, robot, len(robot.steps()) + 3))
        steps = robot.steps()
        assert_same(steps, engine())
        assert_on_wheels(steps, driven)


@pytest.mark.slow
def test_messages_without_a_value_are_told_from_silence(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, MAPPING, tmp_path) as running:
        blind = row(1)
        blind["scan"]["ranges"] = [math.nan if abs(beam - 17.5) > 12 else 1.0 for beam in range(36)]
        robot.publish(blind)
        said = f"waiting: {robot.name}/scan: messages come, but none has a usable value within [150, 210] deg"
        until(lambda: said in running.said())


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_last_command_stops_the_robot(kind: str, number: int, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, MAPPING, tmp_path) as running:
        robot.record_all()
        robot.publish(row(1))
        until(lambda: len(robot.driven()) > 5 and robot.driven()[-1] != (0.0, 0.0))
        running.process.send_signal(number)
        assert running.process.wait(10) == 0
        until(lambda: robot.driven()[-1] == (0.0, 0.0), 5)


@pytest.mark.slow
def test_the_rate_is_that_of_the_mapping(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, {**MAPPING, "rate": 20}, tmp_path):
        robot.record_all()
        robot.publish(row(1))
        until(lambda: len(robot.steps()) > 3)
        first, began = len(robot.steps()), time.monotonic()
        time.sleep(2)
        rate = (len(robot.steps()) - first) / (time.monotonic() - began)
        assert rate == pytest.approx(20, rel=0.15)


@pytest.mark.slow
def test_silence_stops_the_robot_until_it_ends(kind: str, robot: Robot, tmp_path: Path) -> None:
    controller = engine()
    with node(kind, robot, {**MAPPING, "timeout": 2.0}, tmp_path) as running:
        robot.record_all()
        until(lambda: f"waiting for {robot.name}/scan, {robot.name}/sonar" in running.said())
        robot.publish({topic: message for topic, message in row(1).items() if topic != "light"})
        until(lambda: len(robot.driven()) > 20)
        # One sensor is missing: no step, the robot stands.
        assert len(robot.steps()) == 0
        assert set(robot.driven()) == {(0.0, 0.0)}
        robot.publish(row(1))
        until(lambda: len(robot.steps()) > 5)
        assert "all sensors are there: the controller runs at 50 Hz" in running.said()

        robot.silence("sonar")
        silent = time.monotonic()
        until(lambda: robot.driven()[-1] == (0.0, 0.0))
        assert 1.0 < time.monotonic() - silent < 10
        until(lambda: f"stopped: nothing comes from {robot.name}/sonar" in running.said())
        stopped = len(robot.steps())
        count = len(robot.driven())
        until(lambda: len(robot.driven()) > count + 20)
        assert set(robot.driven()[count:]) == {(0.0, 0.0)}
        assert len(robot.steps()) == stopped
        assert running.said().count("stopped:") < 5  # not in each cycle

        # It goes on where it was.
        robot.publish(row(2))
        until(lambda: len(robot.steps()) > stopped + 5)
        assert_same(robot.steps(), controller)

        # The service begins a new episode; nothing is sensed meanwhile: it is known between which steps.
        robot.silence("odom")
        silence = f"stopped: nothing comes from {robot.name}/odom"
        until(lambda: silence in running.said())
        before = len(robot.steps())
        robot("call", service=f"{robot.name}/swarmwright_controller/reset")
        assert "the controller was reset" in running.said()
        robot.publish(row(3))
        until(lambda: len(robot.steps()) > before + 5)
        controller.reset()
        assert_same(robot.steps()[before:], controller)

        # So does a message, which every implementation of DDS delivers.
        said = running.said().count(silence)
        robot.silence("odom")
        until(lambda: running.said().count(silence) > said)
        before = len(robot.steps())
        topic = "swarmwright_controller/reset"
        robot("publish", topic=f"{robot.name}/{topic}", kind="std_msgs/msg/Empty", message={})
        until(lambda: running.said().count("the controller was reset") > 1)
        robot.silence(topic)
        time.sleep(0.3)
        robot.publish(row(4))
        until(lambda: len(robot.steps()) > before + 5)
        controller.reset()
        assert_same(robot.steps()[before:], controller)


@pytest.mark.slow
def test_a_controller_that_begins_anew_after_silence(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, {**MAPPING, "timeout": 2.0, "reset_after_silence": True}, tmp_path) as running:
        robot.record_all()
        robot.publish(row(1))
        until(lambda: len(robot.steps()) > 5)
        # A number that is none is as good as nothing.
        robot.publish({"light": {"data": math.nan}})
        unusable = f"{robot.name}/light: messages come, but none has a usable value"
        until(lambda: f"stopped: {unusable}" in running.said())
        # The reason is brought up to date.
        robot.silence("sonar")
        until(lambda: f"stopped: nothing comes from {robot.name}/sonar; {unusable}" in running.said())
        before = len(robot.steps())
        robot.publish(row(2))
        until(lambda: len(robot.steps()) > before + 5)
        assert_same(robot.steps()[before:], engine())


@pytest.mark.slow
def test_a_stamped_command_has_the_time(kind: str, robot: Robot, tmp_path: Path) -> None:
    def stamped(mapping: dict[str, Any]) -> None:
        for entry in mapping["actuators"][:2]:
            entry.update(type="geometry_msgs/msg/TwistStamped", field="twist." + entry["field"])

    with node(kind, robot, changed(stamped), tmp_path):
        robot.record("cmd_vel", "geometry_msgs/TwistStamped")
        robot.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        robot.publish(row(1))
        until(lambda: len(robot.steps()) > 5)
        for message in robot.recorded("cmd_vel"):
            stamp = message["header"]["stamp"]
            assert abs(stamp["sec"] + stamp["nanosec"] * 1e-9 - time.time()) < 60
        twist = robot.recorded("cmd_vel")[-1]["twist"]
        assert (twist["linear"]["x"], twist["angular"]["z"]) in commands(robot.steps()[:, 7:])


@pytest.mark.slow
def test_simulated_time_is_that_of_the_clock(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, {**MAPPING, "rate": 10}, tmp_path, "--use-sim-time") as running:
        robot.record_all()
        robot.publish(row(1))
        # There is no time yet, and so no cycle.
        until(lambda: "stopped: nothing comes from /clock, and use_sim_time is set" in running.said())
        until(lambda: len(robot.driven()) > 2)
        assert set(robot.driven()) == {(0.0, 0.0)}

        def tick(tenths: int) -> None:
            robot(
                "publish", topic="/clock", kind="rosgraph_msgs/msg/Clock", reliable=False,
                message={"clock": {"sec": tenths // 10, "nanosec": tenths % 10 * 10**8}},
            )  # fmt: skip

        tenths = 1000
        deadline = time.monotonic() + 60
        while len(robot.steps()) < 10:
            assert time.monotonic() < deadline
            tenths += 1
            tick(tenths)
            time.sleep(0.06)
        # A cycle for each tenth of a second of the simulation; some at the beginning were not heard.
        begun, first = len(robot.steps()), tenths
        for _ in range(10):
            tenths += 1
            tick(tenths)
            time.sleep(0.1)
        assert len(robot.steps()) - begun == pytest.approx(tenths - first, abs=2)
        standing = len(robot.steps())
        until(lambda: "stopped: /clock stands still" in running.said())
        until(lambda: robot.driven()[-1] == (0.0, 0.0))
        assert len(robot.steps()) - standing <= 1  # the simulation pauses
        assert_same(robot.steps(), engine())
        # A simulation that begins anew.
        tenths = 5
        begun = len(robot.steps())
        for _ in range(15):
            tenths += 1
            tick(tenths)
            time.sleep(0.1)
        assert len(robot.steps()) - begun == pytest.approx(15, abs=3)


@pytest.mark.slow
def test_two_robots_in_one_domain(kind: str, package: Package, tmp_path: Path) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
    with (
        Robot(package) as one,
        Robot(package) as two,
        node(kind, one, MAPPING, folders[0]),
        node(kind, two, MAPPING, folders[1]),
    ):
        for robot, index in ((one, 1), (two, 2)):
            robot.record_all()
            robot.publish(row(index))
        until(lambda: grown(one, 10) and grown(two, 10))
        for robot, index in ((one, 1), (two, 2)):
            steps = robot.steps()
            assert_same(steps, engine())
            np.testing.assert_allclose(
                steps[:, :7], np.tile(expected_sensors(index), (len(steps), 1)), rtol=3e-7
            )


@pytest.mark.slow
@pytest.mark.skipif(not SETUP, reason="needs ROS 2, named by SWARMWRIGHT_ROS2")
@pytest.mark.parametrize("kind", ["launch-cpp+rclpy", "launch-python+rclpy"], indirect=True)
def test_the_launch_file_starts_a_node_for_a_robot(kind: str, robot: Robot, tmp_path: Path) -> None:
    with node(kind, robot, MAPPING, tmp_path) as running:
        robot.record_all()
        robot.publish(row(1))
        until(lambda: len(robot.steps()) > 5)
        assert_same(robot.steps(), engine())
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(20) == 0
        until(lambda: robot.driven()[-1] == (0.0, 0.0), 5)


@pytest.mark.slow
def test_domains_are_apart(package: Package, tmp_path: Path) -> None:
    domain = int(package.environment["ROS_DOMAIN_ID"])
    other = environment((domain + 1) % 102)
    with Robot(package) as robot, node("dds", robot, MAPPING, tmp_path, environment=other) as running:
        robot.publish(row(1))
        time.sleep(2)
        assert "waiting for" in running.said()
        assert "all sensors are there" not in running.said()
    with (
        Robot(package) as robot,
        node("dds", robot, MAPPING, tmp_path, "--domain", str(domain), environment=other) as running,
    ):
        robot.publish(row(1))
        until(lambda: "all sensors are there" in running.said())


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_THE_FILE | IN_THE_TOPICS)
def test_a_wrong_mapping_is_refused(kind: str, name: str, package: Package, tmp_path: Path) -> None:
    change, message = (IN_THE_FILE | IN_THE_TOPICS)[name]
    robot = Robot(package)
    robot.name = "/wrong"
    with node(kind, robot, changed(change), tmp_path) as running:
        assert running.process.wait(20) == 2
    assert message in running.said()
    assert "Traceback" not in running.said()


@pytest.mark.slow
def test_others_use_a_topic_with_another_type(kind: str, robot: Robot, tmp_path: Path) -> None:
    robot("publish", topic=f"{robot.name}/laser", kind=SCAN.replace("/", "/msg/"), message={})
    with node(kind, robot, changed(lambda m: m["sensors"][2].update(topic="laser")), tmp_path) as running:
        assert running.process.wait(20) == 2
    assert f"{robot.name}/laser has the type {SCAN}, but the mapping says {RANGE}" in running.said()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rate: [", "mapping.yaml: is not YAML: line 1"),
        ("a: &a [*a]", "is n"),
        ("", "mapping: expected keys and values"),
        ("rate: 1e1\ntimeout: 'a'", "mapping: timeout: 'a' is text, expected a number"),
        ("rate: .nan", "mapping: rate: nan found, expected a number"),
    ],
)
def test_a_file_that_is_no_mapping(
    kind: str, text: str, message: str, package: Package, tmp_path: Path
) -> None:
    with node(kind, Robot(package), text, tmp_path) as running:
        assert running.process.wait(20) == 2
    assert message in running.said()
    assert "Traceback" not in running.said()


@pytest.mark.slow
def test_without_a_file(kind: str, package: Package, tmp_path: Path) -> None:
    with node(kind, Robot(package), None, tmp_path) as running:
        assert running.process.wait(20) == 2
    without = "controller.launch.py sets it, mapping:=FILE"
    assert ("--mapping" if kind.startswith("dds") else without) in running.said()
    done = subprocess.run(
        package.command(kind.partition("+")[0], tmp_path / "none.yaml", "/a"), cwd=package.folder,
        env=package.environment, capture_output=True, text=True, check=False, timeout=30,
    )  # fmt: skip
    assert done.returncode == 2
    assert (
        f"mapping: {tmp_path}/none.yaml: cannot be read: No such file or directory"
        in done.stderr + done.stdout
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ROS_DOMAIN_ID": "x"}, "ROS_DOMAIN_ID=x: expected a number from 0 to 232"),
        ({"CYCLONEDDS_URI": "<General><Nothing/></General>"}, "cannot be joined"),
    ],
)
def test_a_domain_that_cannot_be_joined(
    changes: dict[str, str], message: str, package: Package, tmp_path: Path
) -> None:
    with node("dds", Robot(package), MAPPING, tmp_path, environment=package.environment | changes) as running:
        assert running.process.wait(20) == 2
    assert message in running.said()
    assert "Traceback" not in running.said()
