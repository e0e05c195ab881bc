"""Logs of ROS and MCAP: every message is a row, with columns such as `/robot_1/pose.position.x`.

The unpacked size of a log is checked before a library reads it: a chunk of some kilobytes can unpack to
gigabytes, whatever size it declares. It is unpacked piece by piece, and only counted.
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
"""Largest number of unpacked bytes of a chunk or a message; messages of a chunk take several times as much
memory."""
_UNPACKED_BYTES = 1 << 28
"""Unpacked bytes that are allowed for any log."""
_UNPACKED_TIMES = 100
"""Unpacked size of a larger log, relative to its size; JSON compresses much better than other data."""
_PIECE_BYTES = 1 << 20
_MCAP, _ROS1, _SQLITE, _ZSTD = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"\x28\xb5\x2f\xfd"
_DAMAGED = "its index refers to a position without a record"
_MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX, _FOOTER = 0x05, 0x06, 0x07, 0x08, 0x02
"""Records of MCAP."""
_HEADER, _ROS1_CHUNK, _CHUNK_INFO = 3, 5, 6
"""Records of ROS 1."""

Block = tuple[str, bytes]
"""Compression and content."""


def check_size(name: str, log: Path) -> None:
    """Raise CommandFailure if a log, a file or a folder with a bag, unpacks to more than the limits.

    name: the log's name, for messages.
    """
    files = [log] if not log.is_dir() else sorted(path for path in log.rglob("*") if path.is_file())
    for file in files:
        with file.open("rb") as stream:
            _check_stream(name, stream, file)


def _check_stream(name: str, stream: IO[bytes], file: Path) -> None:
    start, size = stream.read(16), stream.seek(0, 2)
    limit, total = max(_UNPACKED_BYTES, _UNPACKED_TIMES * size), 0
    if start.startswith(_ZSTD):  # the whole file is compressed; unpack it to the disk
        with tempfile.TemporaryFile() as whole:
            stream.seek(0)
            for piece in _unpack_zstd(stream):
                total += whole.write(piece)
                _check_limit(name, total, limit)
            whole.seek(0)
            if whole.read(8) == _MCAP:
                whole.seek(0)
                _check_stream(name, whole, file)
        return
    for compression, block in _iterate_blocks(start, stream, size, file):
        inner = 0
        for piece in _UNPACKERS.get(compression, _unpack_nothing)(block):
            inner += len(piece)
            if inner > LARGEST_CHUNK_BYTES:
                raise CommandFailure(
                    f"{name}: has a chunk or message that unpacks to more than "
                    f"{LARGEST_CHUNK_BYTES >> 20} MiB; record it without compression, or with smaller chunks"
                )
        total += inner
        _check_limit(name, total, limit)


def _check_limit(name: str, total: int, limit: int) -> None:
    if total > limit:
        raise CommandFailure(
            f"{name}: unpacks to more than {limit >> 20:,} MiB; the limit is {_UNPACKED_BYTES >> 20} MiB or "
            f"{_UNPACKED_TIMES} times its size; record it without compression"
        )


def _iterate_blocks(start: bytes, stream: IO[bytes], size: int, file: Path) -> Iterator[Block]:
    """Yield the blocks of a log that are compressed as a whole; none for other formats."""
    if start.startswith(_MCAP):
        yield from _iterate_mcap_chunks(stream, size)
    elif start.startswith(_ROS1):
        yield from _iterate_ros1_chunks(stream, size)
    elif start.startswith(_SQLITE):
        yield from _iterate_messages(file)


def _iterate_mcap_chunks(stream: IO[bytes], size: int) -> Iterator[Block]:
    """Yield the chunks of an MCAP file. Raises ValueError if its index does not match them."""
    chunks, sections, indexed, summary = set(), {0}, set(), 0
    at = stream.seek(len(_MCAP))
    while size - at >= 9 + len(_MCAP):
        kind, length = struct.unpack("<BQ", stream.read(9))
        if kind == _CHUNK:
            chunks.add(at)
            head = stream.read(32)  # times, unpacked size, checksum, length of the compression's name
            compression = stream.read(struct.unpack("<I", head[28:])[0])
            stored = struct.unpack("<Q", stream.read(8))[0]
            yield compression.decode(errors="replace"), stream.read(min(stored, size))
        elif kind == _CHUNK_INDEX:
            indexed.add(struct.unpack("<Q", stream.read(24)[16:])[0])
        elif kind == _FOOTER:
            summary = struct.unpack("<Q", stream.read(8))[0]
            if at != size - 29 - len(_MCAP):
                raise ValueError("it has more than one footer")
        if kind not in (_MESSAGE, _CHUNK, _MESSAGE_INDEX):
            sections.add(at)
        at = stream.seek(at + 9 + length)
    if not indexed <= chunks or summary not in sections:
        raise ValueError(_DAMAGED)


def _iterate_ros1_chunks(stream: IO[bytes], size: int) -> Iterator[Block]:
    """Yield the chunks of a ROS 1 bag. Raises ValueError if its index does not match them."""
    chunks, records, indexed, index = set(), {0, size}, set(), 0
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
            indexed.add(int.from_bytes(fields.get(b"chunk_pos", b""), "little"))
        elif kind == _HEADER:
            index = int.from_bytes(fields.get(b"index_pos", b""), "little")
        at = stream.seek(end)
    if not indexed <= chunks or index not in records:
        raise ValueError(_DAMAGED)


def _header_fields(header: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at < len(header):
        length = struct.unpack("<I", header[at : at + 4])[0]
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        yield name, value
        at += 4 + length


def _iterate_messages(file: Path) -> Iterator[Block]:
    """Yield the compressed messages of a ROS 2 bag."""
    with closing(sqlite3.connect(f"file:{file.as_posix()}?mode=ro", uri=True)) as database:
        kinds = dict(database.execute("SELECT name, type FROM sqlite_master"))
        for name in ("messages", "topics"):  # a view could be endless
            if kinds.get(name, "table") != "table":
                raise ValueError(f"{name} is not a table")
        if "messages" in kinds:
            for (data,) in database.execute("SELECT data FROM messages WHERE typeof(data) = 'blob'"):
                if data.startswith(_ZSTD):
                    yield "zstd", data


def _unpack_zstd(data: Any) -> Iterator[bytes]:  # noqa: ANN401 - bytes or a stream
    import zstandard  # noqa: PLC0415 - may not be installed

    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True, closefd=False) as reader:
        while piece := reader.read(_PIECE_BYTES):
            yield piece


def _unpack(make: Callable[[], Any], data: bytes) -> Iterator[bytes]:
    """Yield the unpacked pieces of all streams in data, using decompressors like the standard library's."""
    while data:
        decompressor = make()
        piece = decompressor.decompress(data, max_length=_PIECE_BYTES)
        while piece or not (decompressor.eof or decompressor.needs_input):
            yield piece
            if decompressor.eof:
                break
            piece = decompressor.decompress(b"", max_length=_PIECE_BYTES)
        data = decompressor.unused_data or b""


def _unpack_lz4(data: bytes) -> Iterator[bytes]:
    from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415 - may not be installed

    yield from _unpack(LZ4FrameDecompressor, data)


def _unpack_bz2(data: bytes) -> Iterator[bytes]:
    yield from _unpack(bz2.BZ2Decompressor, data)


def _unpack_nothing(_data: bytes) -> Iterator[bytes]:
    """Yield nothing, because the block is not compressed."""
    yield from ()


_UNPACKERS: dict[str, Callable[[bytes], Iterator[bytes]]] = {
    "zstd": _unpack_zstd,
    "lz4": _unpack_lz4,
    "bz2": _unpack_bz2,
}


_ITEMS = 64
"""Largest number of items of an array that become columns, `ranges.0`, `ranges.1`, .."""
_WORDS = 200
"""Largest number of characters of a library's message, which may repeat the definitions of all types."""
_NEEDED = {"rosbag": ("rosbags",), "mcap": ("rosbags", "mcap")}

Row = tuple[str, dict[str, Any]]


def explain_missing_library(form: str) -> str | None:
    """Return why logs of a format cannot be read on this machine; None if they can."""
    for module in _NEEDED.get(form, ()):
        if importlib.util.find_spec(module) is None:
            return (
                f"{module}, which reads logs of the format {form}, is not installed; "
                "pip install 'swarmwright[rosbag]'"
            )
    return None


def read_rosbag(name: str, file: Path | bytes, columns: Collection[str]) -> Iterator[Row]:
    """Yield the messages of a ROS 1 or 2 bag: all of required topics, the first of other topics."""
    if isinstance(file, bytes):
        raise CommandFailure(f"{name}: a bag must be a file")
    try:
        check_size(name, file)
        yield from _read_messages(name, file, columns)
    except CommandFailure:
        raise
    except Exception as error:  # noqa: BLE001 - the library raises various ones
        raise _make_read_error(name, error) from None


def _read_messages(name: str, file: Path, columns: Collection[str]) -> Iterator[Row]:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415 - may not be installed
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - as above

    topics: set[str] = set()
    with AnyReader([file], default_typestore=get_typestore(Stores.LATEST)) as reader:
        for number, (connection, _, data) in enumerate(reader.messages()):
            topic = connection.topic
            if topic not in topics or _is_wanted(topic, columns):
                topics.add(topic)
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception:
                    if _is_wanted(topic, columns):
                        raise
                    continue  # its type may have changed between versions of ROS
                yield f"{name}: message {number}", dict(_iterate_fields(message, topic))


def read_mcap(name: str, file: Path | bytes, columns: Collection[str]) -> Iterator[Row]:
    """Yield the messages of a file of MCAP, in JSON or as ROS encodes them; as `read_rosbag`."""
    from mcap.reader import make_reader  # noqa: PLC0415 - may not be installed

    if isinstance(file, bytes):
        raise CommandFailure(f"{name}: an MCAP log must be a file")
    topics: set[str] = set()
    try:
        check_size(name, file)
        with file.open("rb") as stream:
            summary = make_reader(stream).get_summary()
            encodings = (
                {channel_.message_encoding for channel_ in summary.channels.values()} if summary else set()
            )
            if "json" not in encodings:
                yield from _read_messages(name, file, columns)
                return
            for number, (_, channel, message) in enumerate(make_reader(stream).iter_messages()):
                topic = channel.topic
                if channel.message_encoding == "json" and (topic not in topics or _is_wanted(topic, columns)):
                    topics.add(topic)
                    yield f"{name}: message {number}", dict(_iterate_fields(json.loads(message.data), topic))
    except CommandFailure:
        raise
    except Exception as error:  # noqa: BLE001 - the library raises various ones
        raise _make_read_error(name, error) from None


def _is_wanted(topic: str, columns: Collection[str]) -> bool:
    return any(column.startswith(f"{topic}.") for column in columns)


def _make_read_error(name: str, error: Exception) -> CommandFailure:
    words = f": {' '.join(str(error).split())[:_WORDS]}" if str(error) else ""
    return CommandFailure(f"{name}: cannot be read: {type(error).__name__}{words}; was the log cut off?")


def _iterate_fields(value: Any, name: str) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - any message
    """Yield the values of a message with their names."""
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
        yield from _iterate_fields(item, f"{name}.{field}")
