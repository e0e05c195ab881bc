"""Logs of ROS and MCAP: every message is a row, with columns such as `/robot_1/pose.position.x`.

Limits on what logs of ROS and MCAP unpack to, checked before their libraries read them whole.

A chunk of some kilobytes can unpack to gigabytes, whatever size it says. Here it is unpacked piece by piece,
and only counted.
"""

import bz2
import importlib.util
import json
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import IO, Any

from swarmwright.simulations.command.process import CommandFailure

LARGEST_CHUNK_BYTES = 1 << 26
"""Unpacked, of a chunk or a message: messages of a chunk take several times as much in memory."""
_UNPACKED_BYTES = 1 << 28
"""That any log may unpack to."""
_UNPACKED_TIMES = 100
"""Of its own size, that a larger one may: text in JSON shrinks much more than other data."""
_PIECE_BYTES = 1 << 20
_MCAP, _ROS1, _SQLITE, _ZSTD = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"\x28\xb5\x2f\xfd"
_DAMAGED = "its index names a place where no record begins"
_MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX, _FOOTER = 0x05, 0x06, 0x07, 0x08, 0x02
"""Records of MCAP."""
_HEADER, _ROS1_CHUNK, _CHUNK_INFO = 3, 5, 6
"""Records of ROS 1."""

Block = tuple[str, bytes]
"""Compression and content."""


def check(name: str, log: Path) -> None:
    """Raise CommandFailure where a log, a file or a folder with a bag, unpacks to more than the limits.

    name: of the log, for messages.
    """
    files = [log] if not log.is_dir() else sorted(path for path in log.rglob("*") if path.is_file())
    for file in files:
        with file.open("rb") as stream:
            _check(name, stream, file)


def _check(name: str, stream: IO[bytes], file: Path) -> None:
    start, size = stream.read(16), stream.seek(0, 2)
    limit, total = max(_UNPACKED_BYTES, _UNPACKED_TIMES * size), 0
    if start.startswith(_ZSTD):  # a whole file, which is unpacked to the disk
        with tempfile.TemporaryFile() as whole:
            stream.seek(0)
            for piece in _zstd(stream):
                total += whole.write(piece)
                _limit(name, total, limit)
            whole.seek(0)
            if whole.read(8) == _MCAP:
                whole.seek(0)
                _check(name, whole, file)
        return
    for compression, block in _blocks(start, stream, size, file):
        inner = 0
        for piece in _UNPACKERS.get(compression, _none)(block):
            inner += len(piece)
            if inner > LARGEST_CHUNK_BYTES:
                raise CommandFailure(
                    f"{name}: has a chunk or message that unpacks to more than "
                    f"{LARGEST_CHUNK_BYTES >> 20} MiB; record it without compression, or with smaller chunks"
                )
        total += inner
        _limit(name, total, limit)


def _limit(name: str, total: int, limit: int) -> None:
    if total > limit:
        raise CommandFailure(
            f"{name}: unpacks to more than {limit >> 20:,} MiB; the limit is {_UNPACKED_BYTES >> 20} MiB or "
            f"{_UNPACKED_TIMES} times its size; record it without compression"
        )


def _blocks(start: bytes, stream: IO[bytes], size: int, file: Path) -> Iterator[Block]:
    """Yield the blocks of a log that are unpacked as wholes; none where its format is another one."""
    if start.startswith(_MCAP):
        yield from _mcap(stream, size)
    elif start.startswith(_ROS1):
        yield from _ros1(stream, size)
    elif start.startswith(_SQLITE):
        yield from _messages(file)


def _mcap(stream: IO[bytes], size: int) -> Iterator[Block]:
    """Yield the chunks of a file of MCAP. Raises ValueError unless its index is one of those."""
    chunks, sections, named, summary = set(), {0}, set(), 0
    at = stream.seek(len(_MCAP))
    while size - at >= 9 + len(_MCAP):
        kind, length = struct.unpack("<BQ", stream.read(9))
        if kind == _CHUNK:
            chunks.add(at)
            head = stream.read(32)  # times, unpacked size, checksum, and how long the compression's name is
            compression = stream.read(struct.unpack("<I", head[28:])[0])
            stored = struct.unpack("<Q", stream.read(8))[0]
            yield compression.decode(errors="replace"), stream.read(min(stored, size))
        elif kind == _CHUNK_INDEX:
            named.add(struct.unpack("<Q", stream.read(24)[16:])[0])
        elif kind == _FOOTER:
            summary = struct.unpack("<Q", stream.read(8))[0]
            if at != size - 29 - len(_MCAP):
                raise ValueError("it has more than one footer")
        if kind not in (_MESSAGE, _CHUNK, _MESSAGE_INDEX):
            sections.add(at)
        at = stream.seek(at + 9 + length)
    if not named <= chunks or summary not in sections:
        raise ValueError(_DAMAGED)


def _ros1(stream: IO[bytes], size: int) -> Iterator[Block]:
    """Yield the chunks of a bag of ROS 1. Raises ValueError unless its index is one of those."""
    chunks, records, named, index = set(), {0, size}, set(), 0
    at = stream.seek(len(_ROS1))
    while size - at >= 8:
        records.add(at)
        header = stream.read(struct.unpack("<I", stream.read(4))[0])
        fields = dict(_header_fields(header))
        length = struct.unpack("<I", stream.read(4))[0]
        end = stream.tell() + length
        kind = fields.get(b"op", b"\0")[0]
        if kind == _ROS1_CHUNK:
            chunks.add(at)
            yield fields.get(b"compression", b"").decode(errors="replace"), stream.read(min(length, size))
        elif kind == _CHUNK_INFO:
            named.add(int.from_bytes(fields.get(b"chunk_pos", b""), "little"))
        elif kind == _HEADER:
            index = int.from_bytes(fields.get(b"index_pos", b""), "little")
        at = stream.seek(end)
    if not named <= chunks or index not in records:
        raise ValueError(_DAMAGED)


def _header_fields(header: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at < len(header):
        length = struct.unpack("<I", header[at : at + 4])[0]
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        yield name, value
        at += 4 + length


def _messages(file: Path) -> Iterator[Block]:
    """Yield the messages of a bag of ROS 2 that may be compressed, each for itself."""
    with closing(sqlite3.connect(f"file:{file.as_posix()}?mode=ro", uri=True)) as database:
        kinds = dict(database.execute("SELECT name, type FROM sqlite_master"))
        for name in ("messages", "topics"):  # a view could go on without end
            if kinds.get(name, "table") != "table":
                raise ValueError(f"{name} is no table")
        if "messages" in kinds:
            for (data,) in database.execute("SELECT data FROM messages WHERE typeof(data) = 'blob'"):
                if data.startswith(_ZSTD):
                    yield "zstd", data


def _zstd(data: Any) -> Iterator[bytes]:  # noqa: ANN401 - bytes or a stream
    import zstandard  # noqa: PLC0415 - may not be installed

    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True, closefd=False) as reader:
        while piece := reader.read(_PIECE_BYTES):
            yield piece


def _pieces(make: Callable[[], Any], data: bytes) -> Iterator[bytes]:
    """Yield what a decompressor of the standard library's kind makes of data; of all streams in it."""
    while data:
        decompressor = make()
        piece = decompressor.decompress(data, max_length=_PIECE_BYTES)
        while piece or not (decompressor.eof or decompressor.needs_input):
            yield piece
            if decompressor.eof:
                break
            piece = decompressor.decompress(b"", max_length=_PIECE_BYTES)
        data = decompressor.unused_data or b""


def _lz4(data: bytes) -> Iterator[bytes]:
    from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415 - may not be installed

    yield from _pieces(LZ4FrameDecompressor, data)


def _bz2(data: bytes) -> Iterator[bytes]:
    yield from _pieces(bz2.BZ2Decompressor, data)


def _none(_data: bytes) -> Iterator[bytes]:
    """Yield nothing: it is read as it is."""
    yield from ()


_UNPACKERS: dict[str, Callable[[bytes], Iterator[bytes]]] = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}


_ITEMS = 64
"""Items of an array that are columns, `ranges.0`, `ranges.1`, .."""
_WORDS = 200
"""Characters of a library's message that are shown: some repeat the definitions of all types."""
_NEEDED = {"rosbag": ("rosbags",), "mcap": ("rosbags", "mcap")}

Row = tuple[str, dict[str, Any]]


def missing(form: str) -> str | None:
    """Return why logs of a format cannot be read here; None where they can."""
    for module in _NEEDED.get(form, ()):
        if importlib.util.find_spec(module) is None:
            cure = "pip install 'swarmwright[rosbag]'"
            return f"{module}, which reads logs of the format {form}, is not installed; {cure}"
    return None


def rosbag(name: str, file: Path | bytes, wanted: Collection[str]) -> Iterator[Row]:
    """Yield the messages of a bag of ROS 1 or 2: of wanted topics all, of others the first one."""
    if isinstance(file, bytes):
        raise CommandFailure(f"{name}: a bag must be a file")
    try:
        check(name, file)
        yield from _rosbag(name, file, wanted)
    except CommandFailure:
        raise
    except Exception as error:  # noqa: BLE001 - the library raises various ones
        raise _unreadable(name, error) from None


def _rosbag(name: str, file: Path, wanted: Collection[str]) -> Iterator[Row]:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415 - may not be installed
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - as above

    seen: set[str] = set()
    with AnyReader([file], default_typestore=get_typestore(Stores.LATEST)) as reader:
        for number, (connection, _, data) in enumerate(reader.messages()):
            topic = connection.topic
            if topic not in seen or _is_wanted(topic, wanted):
                seen.add(topic)
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception:
                    if _is_wanted(topic, wanted):
                        raise
                    continue  # its type may have changed between versions of ROS
                yield f"{name}: message {number}", dict(_fields(message, topic))


def mcap(name: str, file: Path | bytes, wanted: Collection[str]) -> Iterator[Row]:
    """Yield the messages of a file of MCAP, in JSON or as ROS encodes them; as `rosbag`."""
    from mcap.reader import make_reader  # noqa: PLC0415 - may not be installed

    if isinstance(file, bytes):
        raise CommandFailure(f"{name}: a log of MCAP must be a file")
    seen: set[str] = set()
    try:
        check(name, file)
        with file.open("rb") as stream:
            summary = make_reader(stream).get_summary()
            encodings = {one.message_encoding for one in summary.channels.values()} if summary else set()
            if "json" not in encodings:
                yield from _rosbag(name, file, wanted)
                return
            for number, (_, channel, message) in enumerate(make_reader(stream).iter_messages()):
                topic = channel.topic
                if channel.message_encoding == "json" and (topic not in seen or _is_wanted(topic, wanted)):
                    seen.add(topic)
                    yield f"{name}: message {number}", dict(_fields(json.loads(message.data), topic))
    except CommandFailure:
        raise
    except Exception as error:  # noqa: BLE001 - the library raises various ones
        raise _unreadable(name, error) from None


def _is_wanted(topic: str, wanted: Collection[str]) -> bool:
    return any(column.startswith(f"{topic}.") for column in wanted)


def _unreadable(name: str, error: Exception) -> CommandFailure:
    words = f": {' '.join(str(error).split())[:_WORDS]}" if str(error) else ""
    return CommandFailure(f"{name}: cannot be read: {type(error).__name__}{words}; was the log cut off?")


def _fields(value: Any, name: str) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - any message
    """Yield the values of a message by their names."""
    if hasattr(value, "tolist"):  # an array of NumPy
        value = value.tolist()
    if isinstance(value, dict):
        inner = list(value.items())
    elif hasattr(value, "__dataclass_fields__"):
        inner = [
            (member, getattr(value, member))
            for member in value.__dataclass_fields__
            if member != "__msgtype__"
        ]
    elif isinstance(value, list | tuple):
        inner = [(str(index), item) for index, item in enumerate(value[:_ITEMS])]
    else:
        yield name, value
        return
    for field, item in inner:
        yield from _fields(item, f"{name}.{field}")
