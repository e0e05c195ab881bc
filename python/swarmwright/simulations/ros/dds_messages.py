"""Messages and services of ROS 2 for Cyclone DDS, from their published definitions.

The types in `MESSAGES` and `SERVICES` can be used; `define` adds others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cyclonedds.idl import make_idl_struct, types

from .mapping import short_type

_POSE = "geometry_msgs/Point position; geometry_msgs/Quaternion orientation"
_STAMPED = "std_msgs/Header header"

MESSAGES: dict[str, str] = {
    "builtin_interfaces/Time": "int32 sec; uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec; uint32 nanosec",
    "geometry_msgs/Point": "float64 x; float64 y; float64 z",
    "geometry_msgs/Pose": _POSE,
    "geometry_msgs/PoseStamped": f"{_STAMPED}; geometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose; float64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": f"{_STAMPED}; geometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/Quaternion": "float64 x; float64 y; float64 z; float64 w 1",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear; geometry_msgs/Vector3 angular",
    "geometry_msgs/TwistStamped": f"{_STAMPED}; geometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist; float64[36] covariance",
    "geometry_msgs/Vector3": "float64 x; float64 y; float64 z",
    "nav_msgs/Odometry": (
        f"{_STAMPED}; string child_frame_id; geometry_msgs/PoseWithCovariance pose; "
        "geometry_msgs/TwistWithCovariance twist"
    ),
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "sensor_msgs/LaserScan": (
        f"{_STAMPED}; float32 angle_min; float32 angle_max; float32 angle_increment; float32 time_increment; "
        "float32 scan_time; float32 range_min; float32 range_max; float32[] ranges; float32[] intensities"
    ),
    # Since Jazzy there is a further field, `variance`. It is not read, so that both versions work.
    "sensor_msgs/Range": (
        f"{_STAMPED}; uint8 radiation_type; float32 field_of_view; float32 min_range; float32 max_range; "
        "float32 range"
    ),
    "std_msgs/Bool": "bool data",
    "std_msgs/Empty": "",
    "std_msgs/Float32": "float32 data",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout; float32[] data",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Header": "builtin_interfaces/Time stamp; string frame_id",
    "std_msgs/Int32": "int32 data",
    "std_msgs/MultiArrayDimension": "string label; uint32 size; uint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim; uint32 data_offset",
    "std_msgs/String": "string data",
}
"""Fields by type: `type name` or `type name default`, with semicolons between them."""

SERVICES: dict[str, tuple[str, str]] = {
    "std_srvs/Empty": ("", ""),
    "std_srvs/SetBool": ("bool data", "bool success; string message"),
    "std_srvs/Trigger": ("", "bool success; string message"),
}
"""Fields of request and response by type."""


def define(
    messages: dict[str, str] | None = None, services: dict[str, tuple[str, str]] | None = None
) -> None:
    """Add types, in the notation of `MESSAGES` and `SERVICES`."""
    MESSAGES.update(messages or {})
    SERVICES.update(services or {})


class _Kind(NamedTuple):
    """A type of Cyclone DDS, and a default; a class stands for a message of that class."""

    type: Any
    default: Any


_NUMBERS: dict[str, tuple[Any, Any]] = {
    "bool": (bool, False),
    "byte": (types.uint8, 0),
    "char": (types.uint8, 0),
    "float32": (types.float32, 0.0),
    "float64": (types.float64, 0.0),
    "int8": (types.int8, 0),
    "uint8": (types.uint8, 0),
    "int16": (types.int16, 0),
    "uint16": (types.uint16, 0),
    "int32": (types.int32, 0),
    "uint32": (types.uint32, 0),
    "int64": (types.int64, 0),
    "uint64": (types.uint64, 0),
    "string": (str, ""),
}
_SEQUENCE: Any = types.sequence
_ARRAY: Any = types.array
_HEADER = {"client": types.uint64, "sequence": types.int64}
"""Header that rmw_cyclonedds puts before each request and response: the client, and the request's number."""
_classes: dict[str, Any] = {}


def message_type(kind: str) -> Any:
    """Return the class of a message, a dataclass. Raises KeyError for an unknown type."""
    return _structure("msg", short_type(kind), MESSAGES[short_type(kind)])


def service_types(kind: str) -> tuple[Any, Any]:
    """Return the classes of a service's request and response with the header of rmw_cyclonedds.

    Their attribute `data` is ROS's request or response. Raises KeyError for an unknown type.
    """
    name = short_type(kind)
    request, response = SERVICES[name]
    return _make_with_header(f"{name}_Request", request), _make_with_header(f"{name}_Response", response)


def new(message_class: Any) -> Any:
    """Return a message of such a class with the defaults of its definition, nearly always zeros."""
    return message_class(*(_fresh(default) for default in message_class.defaults))


def _fresh(default: Any) -> Any:
    if isinstance(default, list):
        return [_fresh(item) for item in default]
    return new(default) if isinstance(default, type) else default


def _make_with_header(name: str, fields: str) -> Any:
    full = f"{name} with header"
    if full not in _classes:
        package, kind = name.split("/")
        data = _structure("srv", name, fields, nested=True)
        message_class = make_idl_struct(f"{kind}_", f"{package}.srv.dds_.{kind}_", {**_HEADER, "data": data})
        message_class.defaults = [0, 0, data]  # type: ignore[attr-defined] # for `new`
        _classes[full] = message_class
    return _classes[full]


def _structure(group: str, name: str, fields: str, *, nested: bool = False) -> Any:
    if name in _classes:
        return _classes[name]
    package, kind = name.split("/")
    # A DDS structure has at least one member, and ROS adds this to empty ones.
    listed = (
        [part.split() for part in fields.split(";")]
        if fields
        else [["uint8", "structure_needs_at_least_one_member"]]
    )
    kinds: list[tuple[str, _Kind]] = []
    for field in listed:
        members = _kind(field[0])
        if len(field) > 2:
            members = members._replace(default=type(members.default)(float(field[2])))
        kinds.append((field[1], members))
    typename = f"{package}.{group}.dds_.{kind}_" + ("Data_" if nested else "")
    message_class = make_idl_struct(
        f"{kind}_", typename, {field: field_kind.type for field, field_kind in kinds}
    )
    message_class.defaults = [field_kind.default for _, field_kind in kinds]  # type: ignore[attr-defined] # for `new`
    _classes[name] = message_class
    return message_class


def _kind(word: str) -> _Kind:
    """Return the type that a word denotes: `float32`, `float32[]`, `float32[36]`, `std_msgs/Header`."""
    if word.endswith("]"):
        element, _, length = word[:-1].rpartition("[")
        inner = _kind(element)
        if not length:
            return _Kind(_SEQUENCE[inner.type], [])
        return _Kind(_ARRAY[inner.type, int(length)], [inner.default] * int(length))
    if word in _NUMBERS:
        return _Kind(*_NUMBERS[word])
    message_class = message_type(word)
    return _Kind(message_class, message_class)
