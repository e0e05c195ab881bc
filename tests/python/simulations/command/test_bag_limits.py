"""Logs that are small, and would take gigabytes when they are unpacked."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from swarmwright.simulations.command import bags
from swarmwright.simulations.command.process import CommandFailure

TEXT = "a" * 100_000


def mcap(path: Path, compression: str) -> Path:
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as stream:
        writer: Any = Writer(stream, chunk_size=1 << 16, compression=CompressionType[compression])
        writer.start()
        schema = writer.register_schema("text", "jsonschema", b"{}")
        channel = writer.register_channel("/said", "json", schema)
        for step in range(3):
            writer.add_message(channel, step, json.dumps({"x": step, "text": TEXT}).encode(), step)
        writer.finish()
    return path


def ros1(path: Path, compression: str) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types, kind = get_typestore(Stores.ROS1_NOETIC), "std_msgs/msg/String"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        topic = writer.add_connection("/said", kind, typestore=types)
        for step in range(3):
            writer.write(topic, step, types.serialize_ros1(types.types[kind](data=TEXT), kind))
    return path


def ros2(path: Path, plugin: str, mode: str) -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types, kind = get_typestore(Stores.ROS2_HUMBLE), "std_msgs/msg/String"
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection("/said", kind, typestore=types)
        for step in range(3):
            writer.write(topic, step, types.serialize_cdr(types.types[kind](data=TEXT), kind))
    return path


LOGS: dict[str, Callable[[Path], Path]] = {
    "mcap-zstd": lambda folder: mcap(folder / "log.mcap", "ZSTD"),
    "mcap-lz4": lambda folder: mcap(folder / "log.mcap", "LZ4"),
    "ros1-bz2": lambda folder: ros1(folder / "log.bag", "BZ2"),
    "ros1-lz4": lambda folder: ros1(folder / "log.bag", "LZ4"),
    "ros2-messages": lambda folder: ros2(folder / "log", "SQLITE3", "MESSAGE"),
    "ros2-file": lambda folder: ros2(folder / "log", "SQLITE3", "FILE"),
    "ros2-mcap": lambda folder: ros2(folder / "log", "MCAP", "STORAGE"),
    "ros2-mcap-file": lambda folder: ros2(folder / "log", "MCAP", "FILE"),
}


def rows(log: Path) -> int:
    reader = bags.read_mcap if log.suffix == ".mcap" else bags.read_rosbag
    return sum(1 for _ in reader("the log", log, ["/said.text", "/said.data"]))


@pytest.mark.parametrize("kind", LOGS)
def test_what_a_log_unpacks_to_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Also where a log is read, nothing is left out."""
    log = LOGS[kind](tmp_path)
    assert rows(log) == 3
    monkeypatch.setattr(bags, "_UNPACKED_BYTES", 200_000)
    monkeypatch.setattr(bags, "_UNPACKED_TIMES", 1)
    with pytest.raises(CommandFailure, match="the log: unpacks to more than 0 MiB; the limit is 0 MiB or 1 "):
        rows(log)


@pytest.mark.parametrize("kind", [kind for kind in LOGS if "file" not in kind])
def test_chunks_and_messages_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    log = LOGS[kind](tmp_path)
    monkeypatch.setattr(bags, "LARGEST_CHUNK_BYTES", 1 << 16)
    with pytest.raises(
        CommandFailure, match="the log: has a chunk or message that unpacks to more than 0 MiB"
    ):
        rows(log)


def test_a_chunk_of_36_kib_with_a_gigabyte(tmp_path: Path) -> None:
    """It says that it has 1 KiB."""
    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    data = b"".join(packer.compress(bytes(1 << 20)) for _ in range(1024)) + packer.flush()
    head = struct.pack("<QQQI", 0, 0, 1024, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(data))
    chunk = struct.pack("<BQ", 6, len(head) + len(data)) + head + data
    start = (
        b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 12) + struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    )
    end = struct.pack("<BQQQI", 2, 20, 0, 0, 0) + b"\x89MCAP0\r\n"
    log = tmp_path / "log.mcap"
    log.write_bytes(start + chunk + end)
    assert log.stat().st_size < 40_000
    with pytest.raises(CommandFailure, match="unpacks to more than 64 MiB; record it without compression"):
        rows(log)


def test_an_index_that_names_other_places_is_refused(tmp_path: Path) -> None:
    """There a chunk could hide that has not been looked at."""
    log = mcap(tmp_path / "log.mcap", "ZSTD")
    data = bytearray(log.read_bytes())
    offset = data.index(struct.pack("<B", 6), 8 + 9)  # of the first chunk
    while data[offset + 9 + 32 : offset + 9 + 36] != b"zstd":
        offset = data.index(6, offset + 1)
    at = data.rindex(struct.pack("<Q", offset))
    data[at : at + 8] = struct.pack("<Q", offset + 1)
    log.write_bytes(data)
    with pytest.raises(CommandFailure, match="its index refers to a position without a record"):
        rows(log)


def test_a_bag_whose_messages_are_a_view_is_refused(tmp_path: Path) -> None:
    """A view can go on without end."""
    import sqlite3
    from contextlib import closing

    log = ros2(tmp_path / "log", "SQLITE3", "MESSAGE")
    with closing(sqlite3.connect(next(log.glob("*.db3")))) as database:
        database.execute("ALTER TABLE messages RENAME TO others")
        database.execute("CREATE VIEW messages AS SELECT * FROM others")
        database.commit()
    with pytest.raises(CommandFailure, match="messages is not a table"):
        rows(log)
