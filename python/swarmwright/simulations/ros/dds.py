"""ROS 2 topics and services over Cyclone DDS, without an installation of ROS 2.

Topics work with nodes of all DDS implementations that ROS 2 supports. Services follow the convention of
rmw_cyclonedds, so the other node must be started with `RMW_IMPLEMENTATION=rmw_cyclonedds_cpp`.

The environment variables of ROS 2 apply: `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY`,
`ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_STATIC_PEERS`, `CYCLONEDDS_URI`. Cyclone DDS for Python needs Python
3.10.
"""

from __future__ import annotations

import os
import secrets
import sys
import time
from contextlib import suppress
from typing import Any, Callable, NamedTuple, Sequence, TypeVar
from xml.sax.saxutils import quoteattr

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import DDSException as _Failure
from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from .mapping import choice, short_type
from .middleware import MiddlewareError, namespace_of, resolve

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


_Entity = TypeVar("_Entity")
_SLICE_S = 0.1
_MOST_DOMAIN = 232
"""Highest number of a domain, limited by port numbers."""
_SERVICE_DEPTH = 10
_ENDPOINTS = 4096
"""Largest number of endpoints of other nodes that are searched for their types."""
_domains: dict[int, Any] = {}
"""Domains that this process has configured; it can do so only once."""


class Dds:
    """A node over Cyclone DDS in the domain `ROS_DOMAIN_ID`, or 0; see `middleware.Middleware`.

    Args:
        name: name of the node.
        namespace: namespace of relative names.
        domain: number of the domain; None: `ROS_DOMAIN_ID`, else 0. Exported nodes have it as an option.
        use_sim_time: whether to read the time from `/clock`.

    Raises MiddlewareError if the domain is not valid or cannot be joined.
    """

    def __init__(
        self, name: str, namespace: str = "/", *, domain: int | None = None, use_sim_time: bool = False
    ) -> None:
        self.name = name
        self._entities: list[Any] = []
        try:
            self.namespace = namespace_of(namespace)
        except ValueError as error:
            raise MiddlewareError(f"namespace '{namespace}': {error}") from None
        number = _domain() if domain is None else domain
        try:
            _configure(number)
            self._participant = self._register(DomainParticipant(number))
        except _Failure as error:
            raise MiddlewareError(
                f"domain {number} cannot be joined: {_reason(error)}; CYCLONEDDS_URI is "
                f"{os.environ.get('CYCLONEDDS_URI', 'not set')}"
            ) from error
        self._receivers: list[_Receiver] = []
        self._writers: list[Any] = []
        self._discovery_readers = [
            self._register(BuiltinDataReader(self._participant, topic))
            for topic in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
        ]
        self._waiting = WaitSet(self._participant)
        self._use_sim_time = use_sim_time
        self._sim_time: tuple[int, int] | None = None
        if use_sim_time:
            self.subscribe("/clock", "rosgraph_msgs/Clock", self._clock)

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with the reason."""
        return resolve(name, self.namespace, self.name)

    def subscribe(
        self,
        topic: str,
        kind: str,
        callback: Callable[[Any], None],
        depth: int = 1,
        *,
        reliable: bool = False,
    ) -> _Receiver:
        """Subscribe to a topic. Raises MiddlewareError for an unknown type."""
        full = self.resolve(topic)
        qos = _qos(depth, _RELIABLE if reliable else Policy.Reliability.BestEffort)
        return self._receive(full, f"rt{full}", _message(kind), qos, callback, depth)

    def publisher(self, topic: str, kind: str, depth: int = 1) -> _Publisher:
        """Advertise a topic. Raises MiddlewareError for an unknown type."""
        full, message_class = self.resolve(topic), _message(kind)
        return _Publisher(
            full, message_class, self._writer(f"rt{full}", message_class, _qos(depth, _RELIABLE))
        )

    def client(self, service: str, kind: str) -> _Client:
        """Return a client for a service. Raises MiddlewareError for an unknown type."""
        full, (request, response) = self.resolve(service), _service(kind)
        identity = secrets.randbits(63)
        qos = _qos(_SERVICE_DEPTH, _RELIABLE, f"clientid={identity:x};")
        writer = self._writer(f"rq{full}Request", request, qos)
        client = _Client(self, full, short_type(kind), request, identity, writer)
        client.replies = self._receive(full, f"rr{full}Reply", response, qos, client.receive, _SERVICE_DEPTH)
        return client

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; the handler fills in the response. Raises MiddlewareError for an unknown type."""
        full, (request, response) = self.resolve(name), _service(kind)
        qos = _qos(_SERVICE_DEPTH, _RELIABLE, f"serviceid={secrets.randbits(63):x};")
        writer = self._writer(f"rr{full}Reply", response, qos)

        def answer(wrapped: Any) -> None:
            reply = new(response)
            reply.client, reply.sequence = wrapped.client, wrapped.sequence
            handler(wrapped.data, reply.data)
            _await_reader(receiver.reader, writer, wrapped.sample_info.publication_handle)
            _write(writer, reply, full)

        receiver = self._receive(full, f"rq{full}Request", request, qos, answer, _SERVICE_DEPTH)

    def new(self, kind: str) -> Any:
        """Return a message with default values. Raises MiddlewareError for an unknown type."""
        return new(_message(kind))

    def types(self, topic: str) -> Sequence[str]:
        """Return the types with which discovered nodes use a topic."""
        return self._types(f"rt{self.resolve(topic)}")

    def service_types(self, service: str) -> Sequence[str]:
        """Return the types with which discovered nodes offer a service."""
        requests = self._types(f"rq{self.resolve(service)}Request")
        return [request[: -len("_Request")] for request in requests if request.endswith("_Request")]

    def _types(self, name: str) -> list[str]:
        own_guid = self._participant.guid
        types = [
            _ros_type(endpoint.type_name)
            for reader in self._discovery_readers
            for endpoint in reader.read(_ENDPOINTS)
            if endpoint.topic_name == name
            and endpoint.participant_key != own_guid
            and endpoint.sample_info.instance_state == InstanceState.Alive
        ]
        return sorted(set(types))

    def spin_once(self, timeout: float) -> None:
        """Run the callbacks of received messages; if there are none, wait for them, for at most 0.1 s."""
        if self._waiting.wait(int(max(0.0, min(timeout, _SLICE_S)) * 1e9)):
            for receiver in list(self._receivers):
                receiver.take()

    def now(self) -> float:
        """Return seconds of a monotonic clock, or with simulated time of `/clock`."""
        if not self._use_sim_time:
            return time.monotonic()
        seconds, nanoseconds = self._sim_time or (0, 0)
        return seconds + nanoseconds * 1e-9

    def stamp(self, header: Any) -> None:
        """Write ROS time to a header."""
        now = self._sim_time if self._use_sim_time else divmod(time.time_ns(), 1_000_000_000)
        header.stamp.sec, header.stamp.nanosec = now or (0, 0)

    def say(self, level: str, text: str) -> None:
        """Log a line, to standard error."""
        stream = sys.stderr
        stream.write(f"[{level.upper()}] [{self.name}]: {text}\n")
        stream.flush()

    def on_shutdown(self, function: Callable[[], None]) -> None:
        """Do nothing, as nothing else shuts the node down."""

    def has_ended(self) -> bool:
        """Return False, as the node ends with its program."""
        return False

    def close(self) -> None:
        """Leave the domain after published messages have been received, or after 0.1 s."""
        end = time.monotonic() + 0.1
        for writer in self._writers:
            # On a time-out, cyclonedds 11.0 raises AttributeError by mistake.
            with suppress(_Failure, AttributeError):
                writer.wait_for_acks(max(0, int((end - time.monotonic()) * 1e9)))
        time.sleep(0.02)  # for best-effort subscriptions, which do not acknowledge
        for receiver in list(self._receivers):
            self._forget(receiver)
        _delete(self._waiting)
        for entity in reversed(self._entities):
            _delete(entity)
        self._entities.clear()

    def _clock(self, message: Any) -> None:
        self._sim_time = message.clock.sec, message.clock.nanosec

    def _register(self, entity: _Entity) -> _Entity:
        self._entities.append(entity)
        return entity

    def _writer(self, topic: str, message_class: Any, qos: Any) -> Any:
        topic_entity = self._register(Topic(self._participant, topic, message_class))
        writer = self._register(DataWriter(self._participant, topic_entity, qos=qos))
        self._writers.append(writer)
        return writer

    def _receive(
        self, name: str, topic: str, message_class: Any, qos: Any, callback: Callable[[Any], None], depth: int
    ) -> _Receiver:
        topic_entity = self._register(Topic(self._participant, topic, message_class))
        reader = self._register(DataReader(self._participant, topic_entity, qos=qos))
        condition = self._register(ReadCondition(reader, ViewState.Any | SampleState.Any | InstanceState.Any))
        self._waiting.attach(condition)
        receiver = _Receiver(self, name, reader, condition, callback, depth)
        self._receivers.append(receiver)
        return receiver

    def _forget(self, receiver: _Receiver) -> None:
        if receiver in self._receivers:
            self._receivers.remove(receiver)
            self._waiting.detach(receiver.condition)
            for entity in (receiver.condition, receiver.reader):
                self._entities.remove(entity)
                _delete(entity)


class _Receiver:
    """A topic whose messages are passed to a function."""

    def __init__(
        self,
        node: Dds,
        name: str,
        reader: Any,
        condition: Any,
        callback: Callable[[Any], None],
        depth: int,
    ) -> None:
        self.reader, self.condition = reader, condition
        self._node, self._name, self._callback, self._depth = node, name, callback, depth
        self._complained = False

    def take(self) -> None:
        """Pass received messages to the callback."""
        try:
            samples = self.reader.take(self._depth)
        except Exception as error:  # noqa: BLE001 - cyclonedds has no narrower one for bytes that do not fit
            if not self._complained:
                self._node.say(
                    "warning", f"{self._name}: a message cannot be read; its type differs from ours: {error}"
                )
            self._complained = True
            return
        for sample in samples:
            if sample.sample_info.valid_data:
                self._callback(sample)

    def publishers(self) -> int:
        """Return the number of publishers on the topic."""
        return len(self.reader.get_matched_publications())

    def close(self) -> None:
        """Receive no more."""
        self._node._forget(self)


class _Publisher:
    """A topic that is published on."""

    def __init__(self, name: str, message_class: Any, writer: Any) -> None:
        self._name, self._type, self._writer = name, message_class, writer

    def new(self) -> Any:
        """Return a message with the defaults of its definition."""
        return new(self._type)

    def publish(self, message: Any) -> None:
        """Send a message. Raises MiddlewareError for a value that its field cannot hold."""
        _write(self._writer, message, self._name)

    def listeners(self) -> int:
        """Return how many subscriptions receive it."""
        return len(self._writer.get_matched_subscriptions())


class _Client:
    """A service of another node."""

    replies: _Receiver

    def __init__(self, node: Dds, name: str, kind: str, request: Any, identity: int, writer: Any) -> None:
        self._node, self._name, self._kind, self._type = node, name, kind, request
        self._identity, self._writer = identity, writer
        self._sequence = 0
        self._responses: list[Any] = []

    def available(self) -> bool:
        """Return whether a server offers it."""
        return bool(self._writer.get_matched_subscriptions()) and self.replies.publishers() > 0

    def request(self) -> Any:
        """Return a request with the defaults of its definition."""
        return new(self._type).data

    def receive(self, wrapped: Any) -> None:
        """Keep the response to the last request; others are late, or for others."""
        if (wrapped.client, wrapped.sequence) == (self._identity, self._sequence):
            self._responses.append(wrapped.data)

    def call(self, request: Any, timeout: float) -> Any:
        """Return the response. Raises TimeoutError when no server offers the service, or no answer came."""
        deadline = time.monotonic() + timeout
        while not self.available():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{self._name}: {self._absence()}")
            self._node.spin_once(min(0.01, timeout))
        self._sequence += 1
        self._responses.clear()
        wrapped = new(self._type)
        wrapped.client, wrapped.sequence, wrapped.data = self._identity, self._sequence, request
        _write(self._writer, wrapped, self._name)
        while not self._responses:
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0:
                self._sequence += 1  # an answer that comes late is dropped
                raise TimeoutError(f"{self._name}: no answer within {timeout:g} s")
            self._node.spin_once(remaining_s)
        return self._responses[0]

    def _absence(self) -> str:
        other_types = [name for name in self._node.service_types(self._name) if name != self._kind]
        if other_types:
            return f"the service has the type {other_types[0]}, not {self._kind}"
        return f"no node offers this service; {_SERVICES_OF}"


_SERVICES_OF = (
    "services are found where the other node runs with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp, and in the "
    "same domain (ROS_DOMAIN_ID)"
)
_RELIABLE = Policy.Reliability.Reliable(int(_SLICE_S * 1e9))


def _qos(depth: int, reliability: Any, identity: str = "") -> Any:
    """Return the endpoint policies of rmw_cyclonedds."""
    policies = [
        reliability,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    ]
    # A node of Iron or later looks here for a digest of the type, and warns if the user data are empty.
    return Qos(*policies, Policy.Userdata((identity or ";").encode()))


def _await_reader(requests: Any, writer: Any, asker: int) -> None:
    """Wait until a client's reader of responses is discovered, at most 0.1 s.

    It has the same identity as the client's writer of requests.
    """
    deadline = time.monotonic() + _SLICE_S
    identity = _identity(requests.get_matched_publication_data(asker))
    while identity and time.monotonic() < deadline:
        readers = map(writer.get_matched_subscription_data, writer.get_matched_subscriptions())
        if any(_identity(reader) == identity for reader in readers):
            return
        time.sleep(0.005)


def _identity(endpoint: Any) -> bytes | None:
    data = None if endpoint is None else endpoint.qos[Policy.Userdata]
    if data is None:
        return None
    return next((part for part in bytes(data.data).split(b";") if part.startswith(b"clientid=")), None)


def _write(writer: Any, message: Any, name: str) -> None:
    try:
        writer.write(message)
    except _Failure as error:
        if error.code != _Failure.DDS_RETCODE_TIMEOUT:  # a late subscription, which will receive the next
            raise MiddlewareError(f"{name}: cannot be published: {_reason(error)}") from error
    except Exception as error:
        # cyclonedds raises various exceptions for values that do not fit.
        raise MiddlewareError(f"{name}: the message does not fit its type: {error}") from error


def _delete(entity: Any) -> None:
    """Delete an entity immediately, without waiting for the garbage collector."""
    entity.__del__()


def _message(kind: str) -> Any:
    try:
        return message_type(kind)
    except KeyError:
        raise MiddlewareError(
            f"the message type '{kind}' is not supported; expected {choice(sorted(MESSAGES))}"
        ) from None


def _service(kind: str) -> tuple[Any, Any]:
    try:
        return service_types(kind)
    except KeyError:
        raise MiddlewareError(
            f"the service type '{kind}' is not supported; expected {choice(sorted(SERVICES))}"
        ) from None


def _ros_type(name: str) -> str:
    """Return `geometry_msgs/Twist` for `geometry_msgs::msg::dds_::Twist_`; other names unchanged."""
    parts = name.split("::")
    if len(parts) == 4 and parts[2] == "dds_":
        return short_type(f"{parts[0]}/{parts[1]}/{parts[3].rstrip('_')}")
    return name


def _reason(error: Any) -> str:
    return str(error).split(" Occurred", 1)[0].strip()


def _domain() -> int:
    """Return the number of the domain in the environment."""
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdigit() or int(text) > _MOST_DOMAIN:
        raise MiddlewareError(f"ROS_DOMAIN_ID={text}: expected a number from 0 to {_MOST_DOMAIN}")
    return int(text)


def _configure(domain: int) -> None:
    """Configure discovery of Cyclone DDS by the environment variables of ROS 2."""
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").strip().upper()
    loopback = not reach and os.environ.get("ROS_LOCALHOST_ONLY", "").strip() == "1"
    if loopback:
        reach = "LOCALHOST"
    peers = [
        address.strip() for address in os.environ.get("ROS_STATIC_PEERS", "").split(";") if address.strip()
    ]
    if domain in _domains or not (reach in ("LOCALHOST", "OFF") or peers):
        return
    if reach == "LOCALHOST":
        peers = ["localhost", *peers]
    # With ROS_LOCALHOST_ONLY, nodes of Humble use only the loopback interface, with multicast.
    unicast = reach in ("LOCALHOST", "OFF") and not loopback
    general = "<AllowMulticast>false</AllowMulticast>" if unicast else ""
    configuration = os.environ.get("CYCLONEDDS_URI", "").strip()
    if loopback and "<NetworkInterface" not in configuration:
        general += "<Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    if reach == "OFF":
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>ros_discovery_off_{os.getpid()}</Tag>"
    else:
        listed = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in peers)
        discovery = (
            "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
            # Later nodes are notified soon, not after half a minute.
            f"<Peers>{listed}</Peers><SPDPInterval>1s</SPDPInterval>"
        )
    ours = f"<General>{general}</General><Discovery>{discovery}</Discovery>"
    text = f"<CycloneDDS><Domain>{ours}</Domain></CycloneDDS>"
    _domains[domain] = Domain(domain, f"{text},{configuration}" if configuration else text)
