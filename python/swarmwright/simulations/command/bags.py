"""Logs of ROS and MCAP: every message is a row, with columns such as `/robot_1/pose.position.x`."""

import importlib.util
import json
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from swarmwright.simulations.command import bag_limits
from swarmwright.simulations.command.failure import CommandFailure

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
        bag_limits.check(name, file)
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
        bag_limits.check(name, file)
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
        inner = [(one, getattr(value, one)) for one in value.__dataclass_fields__ if one != "__msgtype__"]
    elif isinstance(value, list | tuple):
        inner = [(str(index), one) for index, one in enumerate(value[:_ITEMS])]
    else:
        yield name, value
        return
    for field, one in inner:
        yield from _fields(one, f"{name}.{field}")
