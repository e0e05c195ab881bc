"""The node `swarmwright_controller` of exported packages, on a real roscore."""

import math
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

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
from tests.python.simulations.ros.mistakes import (
    FLOAT,
    IN_THE_FILE,
    IN_THE_TOPICS,
    MAPPING,
    ODOMETRY,
    RANGE,
    SCAN,
    TWIST,
    changed,
)
from tests.ros1.machine import Driver, Master, Workspace, end

pytestmark = pytest.mark.timeout(240)  # the workspace is compiled when the first test starts
TOPICS = {"scan": SCAN, "sonar": RANGE, "odom": ODOMETRY, "light": FLOAT, "target": TWIST}
LACKING = {"sensor": "sensor 6", "source": "constant", "value": 0.1}
NO_PARAMETERS = ("nothing-for-text", "infinity")
"""Values that ROS 1 cannot have as parameters."""


class Running:
    """A node, in a namespace of its own, and what it says."""

    def __init__(self, driver: Driver, process: "subprocess.Popen[str]", name: str, output: Path) -> None:
        self._driver, self.process, self.name, self._output = driver, process, name, output

    def said(self) -> str:
        return self._output.read_text(encoding="utf-8")

    def publish(self, row: "dict[str, Any]") -> None:
        for topic, message in row.items():
            self._driver("publish", topic=f"{self.name}/{topic}", kind=TOPICS[topic], message=message)

    def silence(self, topic: str) -> None:
        self._driver("silence", topic=f"{self.name}/{topic}")

    def record(self, topic: str, kind: str) -> None:
        self._driver("record", topic=f"{self.name}/{topic}", kind=kind)

    def recorded(self, topic: str) -> list[Any]:
        found: list[Any] = self._driver("recorded", topic=f"{self.name}/{topic}")
        return found

    def steps(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """(steps, sensors + actuators)."""
        data = [step["data"] for step in self.recorded("swarmwright_controller/steps")]
        return np.array(data, np.float32).reshape(len(data), 10)


def grown(running: Running, steps: int) -> bool:
    return len(running.steps()) > steps


@contextmanager
def node(
    master: Master,
    driver: Driver,
    mapping: "dict[str, Any] | None",
    folder: Path,
    name: str = "robot",
    remappings: Sequence[str] = (),
) -> Iterator[Running]:
    """The node with a mapping, in the namespace `/name`."""
    if mapping is not None:
        driver("set", name=f"/{name}/swarmwright_controller/mapping", value=mapping)
    output = folder / "said.txt"
    with output.open("w", encoding="utf-8") as file:
        process = master.workspace.start(
            "devel/lib/rover/swarmwright_controller", f"__ns:={name}", *remappings,
            stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        yield Running(driver, process, f"/{name}", output)
    finally:
        end(process)
        print(output.read_text(encoding="utf-8"))


def driven(running: Running) -> list[tuple[float, float]]:
    return [(one["linear"]["x"], one["angular"]["z"]) for one in running.recorded("cmd_vel")]


def test_the_node_computes_what_the_engine_computes(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = engine()
    with node(master, driver, MAPPING, tmp_path) as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.record("cmd_vel", TWIST)
        running.record("gripper", FLOAT)
        for index in range(12):
            running.publish(row(index))
            count = len(running.steps())
            until(partial(grown, running, count + 8))
        labels = running.recorded("swarmwright_controller/steps")[-1]["layout"]["dim"]
        assert labels == [{"label": "sensors, actuators", "size": 10, "stride": 10}]
        steps = running.steps()
        sensors, actuators = steps[:, :7], np.ascontiguousarray(steps[:, 7:])
        # Every sensor had all its values, in their order, and no others: up to the last bit of a sum.
        wanted = np.array([expected_sensors(index) for index in range(12)])
        for number in range(7):
            seen = [
                value
                for value, before in zip(sensors[1:, number], sensors[:, number], strict=False)
                if value != before
            ]
            distinct = list(dict.fromkeys(wanted[:, number].tolist()))
            np.testing.assert_allclose(
                [sensors[0, number], *seen], distinct, rtol=3e-7, err_msg=f"sensor {number}"
            )
        # The same actuators as the engine's controller, which has the same state, in every step.
        np.testing.assert_array_equal(actuators.view(np.uint32), computed(controller, sensors))
        assert len(np.unique(actuators, axis=0)) >= 12
        # Every command is that of a step, in their order; zeros before the first one.
        said = commands(actuators)
        until(lambda: driven(running)[-1] == said[-1] or len(running.steps()) > len(steps))
        given = [one for one in driven(running) if one != (0.0, 0.0)]
        rest = iter(commands(running.steps()[:, 7:]))
        assert all(one in rest for one in given)
        assert len(given) > len(said) / 2
        assert running.recorded("gripper")[-1]["data"] in running.steps()[:, 9].tolist()
        assert running.process.poll() is None
        count = len(driven(running))
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(10) == 0
        # The last command stops the robot.
        until(lambda: len(driven(running)) > count and driven(running)[-1] == (0.0, 0.0))


def test_names_are_remapped_once(master: Master, driver: Driver, tmp_path: Path) -> None:
    swapped = ["scan:=sonar", "sonar:=scan"]
    with node(master, driver, MAPPING, tmp_path, "swapped", swapped) as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        until(lambda: "waiting for /swapped/sonar, /swapped/scan" in running.said())
        messages = row(1)
        scan, sonar = messages.pop("scan"), messages.pop("sonar")
        running.publish(messages)
        driver("publish", topic="/swapped/sonar", kind=SCAN, message=scan)
        driver("publish", topic="/swapped/scan", kind=RANGE, message=sonar)
        until(partial(grown, running, 3))
        np.testing.assert_allclose(running.steps()[-1, :7], expected_sensors(1), rtol=3e-7)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_the_node_ends_without_a_master(how: signal.Signals, workspace: Workspace, tmp_path: Path) -> None:
    with socket.socket() as closed:  # bound, but nothing listens
        closed.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{closed.getsockname()[1]}"
        output = tmp_path / "said.txt"
        with output.open("w", encoding="utf-8") as file:
            process = workspace.start(
                "env", f"ROS_MASTER_URI={uri}", "devel/lib/rover/swarmwright_controller",
                stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
            )  # fmt: skip
        try:
            until(lambda: f"no master answers at {uri}" in output.read_text(encoding="utf-8"))
            process.send_signal(how)
            assert process.wait(20) == 0
        finally:
            end(process)


def test_the_node_ends_when_the_master_is_lost(master: Master, tmp_path: Path) -> None:
    workspace = master.workspace
    kept = workspace.environment["ROS_MASTER_URI"]
    try:
        with (
            Master(workspace) as lost,
            Driver(lost) as driver,
            node(lost, driver, MAPPING, tmp_path, "lost") as running,
        ):
            running.record("cmd_vel", TWIST)
            until(lambda: "waiting for" in running.said())
            lost.kill()
            time.sleep(2)  # the node looks at the types of topics again every second
            count = len(driven(running))
            until(lambda: len(driven(running)) > count + 20)
            running.process.send_signal(signal.SIGINT)
            assert running.process.wait(20) == 0
    finally:
        workspace.environment["ROS_MASTER_URI"] = kept


def drives(running: Running) -> bool:
    return bool(driven(running)) and driven(running)[-1] != (0.0, 0.0)


ANOTHER = "import rospy; rospy.init_node('swarmwright_controller'); rospy.sleep(5)"
"""A node of the same name, which commands nothing."""


@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGHUP", "rosnode kill", "another node"])
def test_whatever_ends_the_node_stops_the_robot(
    how: str, master: Master, driver: Driver, tmp_path: Path
) -> None:
    with node(master, driver, MAPPING, tmp_path, "ended") as running:
        running.record("cmd_vel", TWIST)
        running.publish(row(1))
        until(partial(drives, running))
        if how == "another node":
            other = master.workspace.start("/usr/bin/python3", "-c", ANOTHER, "__ns:=ended")
            running.process.wait(20)
            end(other)
        elif how == "rosnode kill":
            driver("kill", node="/ended/swarmwright_controller")
        else:
            running.process.send_signal(getattr(signal, how))
        assert running.process.wait(10) == 0
        until(lambda: driven(running)[-1] == (0.0, 0.0), 5)
        assert ("told to end" in running.said()) == (not how.startswith("SIG"))


def test_a_clock_that_does_not_come_or_stands_still_stops_the_robot(
    master: Master, driver: Driver, tmp_path: Path
) -> None:
    def tick(tenths: int) -> None:
        clock = {"secs": tenths // 10, "nsecs": tenths % 10 * 10**8}
        driver("publish", topic="/clock", kind="rosgraph_msgs/Clock", message={"clock": clock})

    driver("set", name="/use_sim_time", value=True)
    try:
        with node(master, driver, {**MAPPING, "rate": 10}, tmp_path, "clock") as running:
            running.record("cmd_vel", TWIST)
            running.publish(row(1))
            until(lambda: "stopped: nothing comes from /clock, and use_sim_time is set" in running.said())
            until(lambda: len(driven(running)) > 2)
            assert set(driven(running)) == {(0.0, 0.0)}
            tenths = 1000
            while not drives(running):
                tenths += 1
                tick(tenths)
                time.sleep(0.05)
            assert "/clock goes on" in running.said()
            until(lambda: "stopped: /clock stands still" in running.said())
            until(lambda: driven(running)[-1] == (0.0, 0.0))
    finally:
        driver("set", name="/use_sim_time", value=False)
        driver("silence", topic="/clock")


def test_a_sensor_that_the_robot_lacks_has_a_constant(master: Master, driver: Driver, tmp_path: Path) -> None:
    mapping = changed(lambda m: m["sensors"].__setitem__(5, LACKING))
    with node(master, driver, mapping, tmp_path, "lacking") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.publish({topic: message for topic, message in row(1).items() if topic != "light"})
        until(partial(grown, running, 3))
        assert set(running.steps()[:, 6].tolist()) == {float(np.float32(0.1))}


def test_wheels_are_a_command_and_a_sensor_may_be_random(
    master: Master, driver: Driver, tmp_path: Path
) -> None:
    with node(master, driver, changed(on_wheels), tmp_path, "wheels") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.record("cmd_vel", TWIST)
        for index in range(4):
            running.publish(row(index))
            until(partial(grown, running, len(running.steps()) + 8))
        moved = driven(running)
        until(partial(grown, running, len(running.steps()) + 3))
        steps = running.steps()
        np.testing.assert_array_equal(
            np.ascontiguousarray(steps[:, 7:]).view(np.uint32), computed(engine(), steps[:, :7])
        )
        assert_on_wheels(steps, moved)


def test_messages_without_a_value_are_told_from_silence(
    master: Master, driver: Driver, tmp_path: Path
) -> None:
    with node(master, driver, MAPPING, tmp_path, "blind") as running:
        blind = row(1)
        blind["scan"]["ranges"] = [math.nan if abs(beam - 17.5) > 12 else 1.0 for beam in range(36)]
        running.publish(blind)
        said = "waiting: /blind/scan: messages come, but none has a usable value within [150, 210] degrees"
        until(lambda: said in running.said())


def test_a_corrected_mapping_replaces_the_one_before(master: Master, tmp_path: Path) -> None:
    said = ""
    for name, changes in (("first", {"reset_after_silence": True}), ("corrected", {"rate": 20})):
        file = tmp_path / f"{name}.yaml"
        file.write_text(yaml.safe_dump({**MAPPING, **changes}), encoding="utf-8")
        output = tmp_path / f"{name}.txt"
        with output.open("w", encoding="utf-8") as stream:
            process = master.workspace.start(
                "roslaunch", "rover", "controller.launch", f"mapping:={file}", "robot:=corrected",
                stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
            )  # fmt: skip
        try:
            until(lambda output=output: "waiting for" in output.read_text(encoding="utf-8"))  # type: ignore[misc]
            said = master.workspace.run("rosparam", "get", "/corrected/swarmwright_controller/mapping")
        finally:
            end(process)
    assert yaml.safe_load(said).keys() == MAPPING.keys()


def test_silence_stops_the_robot_until_it_ends(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = engine()
    mapping = {**MAPPING, "timeout": 2.0}
    with node(master, driver, mapping, tmp_path, "silent") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.record("cmd_vel", TWIST)
        until(lambda: "waiting for /silent/scan, /silent/sonar" in running.said())
        running.publish({topic: message for topic, message in row(1).items() if topic != "light"})
        until(lambda: len(driven(running)) > 20)
        # One sensor is missing: no step, the robot stands.
        assert len(running.steps()) == 0
        assert set(driven(running)) == {(0.0, 0.0)}
        running.publish(row(1))
        until(lambda: len(running.steps()) > 5)
        assert "all sensors are there: the controller runs at 50 Hz" in running.said()

        running.silence("sonar")
        silent = time.monotonic()
        until(lambda: driven(running)[-1] == (0.0, 0.0))
        assert 1.0 < time.monotonic() - silent < 10
        until(lambda: "stopped: nothing comes from /silent/sonar" in running.said())
        stopped = len(running.steps())
        count = len(driven(running))
        until(lambda: len(driven(running)) > count + 20)
        assert set(driven(running)[count:]) == {(0.0, 0.0)}
        assert len(running.steps()) == stopped
        assert running.said().count("stopped:") < 5  # not in each cycle

        # It goes on where it was.
        running.publish(row(2))
        until(lambda: len(running.steps()) > stopped + 5)
        steps = running.steps()
        np.testing.assert_array_equal(
            np.ascontiguousarray(steps[:, 7:]).view(np.uint32), computed(controller, steps[:, :7])
        )

        # The service begins a new episode; nothing is sensed meanwhile: it is known between which steps.
        running.silence("odom")
        until(lambda: "stopped: nothing comes from /silent/odom" in running.said())
        before = len(running.steps())
        driver("call", service="/silent/swarmwright_controller/reset")
        running.publish(row(3))
        until(lambda: len(running.steps()) > before + 5)
        after = running.steps()[before:]
        controller.reset()
        np.testing.assert_array_equal(
            np.ascontiguousarray(after[:, 7:]).view(np.uint32), computed(controller, after[:, :7])
        )


def test_a_controller_that_begins_anew_after_silence(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = engine()
    mapping = {**MAPPING, "timeout": 2.0, "reset_after_silence": True}
    with node(master, driver, mapping, tmp_path, "anew") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.publish(row(1))
        until(lambda: len(running.steps()) > 5)
        # A number that is none is as good as nothing.
        running.publish({"light": {"data": math.nan}})
        unusable = "/anew/light: messages come, but none has a usable value"
        until(lambda: f"stopped: {unusable}" in running.said())
        # The reason is brought up to date.
        running.silence("sonar")
        until(lambda: f"stopped: nothing comes from /anew/sonar; {unusable}" in running.said())
        before = len(running.steps())
        running.publish(row(2))
        until(lambda: len(running.steps()) > before + 5)
        after = running.steps()[before:]
        np.testing.assert_array_equal(
            np.ascontiguousarray(after[:, 7:]).view(np.uint32), computed(controller, after[:, :7])
        )


WRONG: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    **{name: one for name, one in IN_THE_FILE.items() if name not in NO_PARAMETERS},
    **IN_THE_TOPICS,
    "other-publisher": (
        lambda m: m["sensors"][2].update(topic="/wrong/laser"),
        "/wrong/laser has the type sensor_msgs/LaserScan, but the mapping says sensor_msgs/Range",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_mapping_is_refused(name: str, master: Master, driver: Driver, tmp_path: Path) -> None:
    change, message = WRONG[name]
    driver("advertise", topic="/wrong/laser", kind=SCAN)
    with node(master, driver, changed(change), tmp_path, "wrong") as running:
        assert running.process.wait(20) == 2
    assert message in running.said()


def test_without_a_mapping(master: Master, driver: Driver, tmp_path: Path) -> None:
    with node(master, driver, None, tmp_path, "none") as running:
        assert running.process.wait(20) == 2
    assert (
        "the parameter ~mapping is missing; controller.launch loads it from a file, mapping:=FILE"
        in running.said()
    )
