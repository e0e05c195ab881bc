"""Messages of ROS 2 made and written by another implementation, rosbags, from the published definitions."""

import random
import struct
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

DISTRIBUTIONS = {"humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY}
_SERVICES = {
    "Empty_Request": "",
    "Empty_Response": "",
    "SetBool_Request": "bool data",
    "SetBool_Response": "bool success\nstring message",
    "Trigger_Request": "",
    "Trigger_Response": "bool success\nstring message",
}


_FILLER = "structure_needs_at_least_one_member"
_NO_FIELDS = ("__msgtype__", _FILLER, "ULTRASOUND", "INFRARED")


def store(distribution: str = "humble") -> Any:
    """Types of a distribution."""
    found = get_typestore(DISTRIBUTIONS[distribution])
    for name, fields in _SERVICES.items():
        found.register(get_types_from_msg(fields, f"std_srvs/msg/{name}"))
    return found


def drawn(types: Any, kind: str, numbers: random.Random) -> Any:
    """A message with random values in all its fields."""
    _, fields = types.fielddefs[kind]
    return types.types[kind](*(0 if name == _FILLER else _value(types, one, numbers) for name, one in fields))


def encoded(types: Any, message: Any) -> bytes:
    """A message as it is on the wire."""
    return bytes(types.serialize_cdr(message, message.__msgtype__))


def decoded(types: Any, kind: str, data: bytes) -> Any:
    """What is on the wire, as a message."""
    return types.deserialize_cdr(data, kind)


_RANGES = {
    "byte": 7,
    "int8": 7,
    "int16": 15,
    "int32": 31,
    "int64": 63,
    "uint8": 8,
    "uint16": 16,
    "uint32": 32,
    "uint64": 64,
}


def _value(types: Any, field: tuple[Any, Any], numbers: random.Random) -> Any:
    node, what = field
    if node == Nodetype.NAME:
        return drawn(types, what, numbers)
    if node == Nodetype.BASE:
        return _number(what[0], numbers)
    element, length = what
    values = [_value(types, element, numbers) for _ in range(length or numbers.randrange(9))]
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        return np.array(values, dtype=element[1][0])
    return values


def _number(kind: str, numbers: random.Random) -> Any:
    if kind == "string":
        return "".join(numbers.choices("abc/ äß", k=numbers.randrange(9)))
    if kind == "bool":
        return numbers.random() < 0.5
    if kind == "float32":
        return struct.unpack("f", struct.pack("f", numbers.uniform(-1e3, 1e3)))[0]
    if kind == "float64":
        return numbers.uniform(-1e9, 1e9)
    return numbers.randrange(1 << _RANGES[kind])


def plain(message: Any) -> Any:
    """A message of any implementation as dictionaries, lists and numbers."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list | tuple):
        return [plain(one) for one in message]
    fields = getattr(message, "__dataclass_fields__", None)
    if fields is None:
        return message
    return {name: plain(getattr(message, name)) for name in fields if name not in _NO_FIELDS}
