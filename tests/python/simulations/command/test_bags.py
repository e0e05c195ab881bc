"""Logs that are bags of ROS 1 and 2, or files of MCAP."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError, RunError, simulate
from swarmwright.simulations.command import logs
from swarmwright.simulations.command.process import CommandFailure
from tests.python.simulations.command.processes import Traced

pytest.importorskip("rosbags")

METRICS = {"x": "mean(/robot.x)", "n": "count(/robot.x)"}


def write_ros1(path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        _write(writer, types, types.serialize_ros1)


def write_ros2(path: Path, plugin: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        _write(writer, types, types.serialize_cdr)


def _write(writer: Any, types: Any, serialize: Any) -> None:
    """Robots' positions, and a topic with another type of which no column is wanted."""
    point, text = "geometry_msgs/msg/Point", "std_msgs/msg/String"
    other = writer.add_connection("/said", text, typestore=types)
    writer.write(other, 0, serialize(types.types[text](data="begin"), text))
    poses = writer.add_connection("/robot", point, typestore=types)
    for step in range(3):
        writer.write(poses, step + 1, serialize(types.types[point](x=step * 0.5, y=0.0, z=1.0), point))


def write_mcap(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer: Any = Writer(stream)
        writer.start()
        schema = writer.register_schema("position", "jsonschema", b"{}")
        channel = writer.register_channel("/robot", "json", schema)
        for step in range(3):
            data = json.dumps({"x": step * 0.5, "name": "one", "ranges": [1, 2]}).encode()
            writer.add_message(channel, step, data, step)
        writer.finish()


def run(traced: Traced, log: str, **definition: Any) -> float:
    values: dict[str, Any] = {"metrics": METRICS, "fitness": "x + n", **definition}
    return simulate(traced.shell(f"cp -r {{here}}/{log} .", log=log, **values))


@pytest.mark.slow
@pytest.mark.parametrize(
    "log", ["ros1.bag", "sqlite", "sqlite/sqlite.db3", "ros2", "ros2/ros2.mcap", "json.mcap"]
)
def test_messages_are_rows(traced: Traced, log: str) -> None:
    write_ros1(traced.folder / "ros1.bag")
    write_ros2(traced.folder / "sqlite", "SQLITE3")
    write_ros2(traced.folder / "ros2", "MCAP")
    write_mcap(traced.folder / "json.mcap")
    # A file of a bag that is a folder can stand alone.
    if "/" in log:
        (traced.folder / Path(log).name).write_bytes((traced.folder / log).read_bytes())
    form = "auto" if "." in log else "rosbag"
    assert run(traced, Path(log).name, log_format=form) == 0.5 + 3


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_arrays_are_columns_of_items(tmp_path: Path, plugin: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    array, layout = (
        types.types["std_msgs/msg/Float32MultiArray"],
        types.types["std_msgs/msg/MultiArrayLayout"],
    )
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        topic = writer.add_connection("/scan", array.__msgtype__, typestore=types)
        for step in range(3):
            message = array(
                layout=layout(dim=[], data_offset=0), data=np.array([step, step + 0.5], np.float32)
            )
            writer.write(topic, step, types.serialize_cdr(message, array.__msgtype__))
    found = logs.read({"bag": tmp_path / "bag"}, "rosbag", ["/scan.data.0", "/scan.data.1"])
    assert found == {"/scan.data.0": [0, 1, 2], "/scan.data.1": [0.5, 1.5, 2.5]}


@pytest.mark.parametrize("wanted", ["/robot.x", "/said.data"])
def test_other_topics_may_have_messages_that_cannot_be_read(tmp_path: Path, wanted: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    point = types.types["geometry_msgs/msg/Point"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        other = writer.add_connection("/said", "std_msgs/msg/String", typestore=types)
        writer.write(other, 0, b"\0\1\0\0\xff\0\0\0cut off")
        topic = writer.add_connection("/robot", point.__msgtype__, typestore=types)
        writer.write(topic, 1, types.serialize_cdr(point(x=0.5, y=0.0, z=1.0), point.__msgtype__))
    if wanted == "/robot.x":
        assert logs.read({"bag": tmp_path / "bag"}, "rosbag", [wanted]) == {wanted: [0.5]}
    else:
        with pytest.raises(CommandFailure, match=r"^bag: cannot be read: .* was the log cut off\?$"):
            logs.read({"bag": tmp_path / "bag"}, "rosbag", [wanted])


@pytest.mark.slow
def test_a_column_that_is_not_there(traced: Traced) -> None:
    write_mcap(traced.folder / "json.mcap")
    with pytest.raises(
        RunError, match=r"has no column '/robot\.z'; did you mean '/robot\.x'\? available: /robot\.x, "
    ):
        run(traced, "json.mcap", metrics={"x": "last(/robot.z)"}, fitness="x")


@pytest.mark.slow
@pytest.mark.parametrize("log", ["ros1.bag", "json.mcap"])
def test_half_a_log(traced: Traced, log: str) -> None:
    (write_mcap if log == "json.mcap" else write_ros1)(traced.folder / log)
    whole = (traced.folder / log).read_bytes()
    (traced.folder / log).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RunError, match=rf"{log}: cannot be read: .*; was the log cut off\?"):
        run(traced, log)


def test_without_the_libraries(traced: Traced, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(
        InputError, match=r"log: rosbags, which reads .* not installed; pip install 'swarmwright\[ros"
    ):
        run(traced, "ros1.bag")
