"""A robot on the wire: reads lines [what, arguments], answers each with one of JSON.

It knows nothing of Swarmwright: its messages are made from the definitions that rosbags ships, and it uses
Cyclone DDS as a program of its own would.
"""

import json
import os
import sys
import threading
import time
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

_BASES: dict[str, Any] = {"bool": bool, "string": str}


class Messages:
    """Classes of messages, and messages from plain values."""

    def __init__(self) -> None:
        self._fields = get_typestore(Stores.ROS2_HUMBLE).fielddefs
        self._made: dict[str, Any] = {}

    def type(self, kind: str) -> Any:
        """The class for `geometry_msgs/msg/Twist`."""
        if kind not in self._made:
            package, _, name = kind.split("/")
            fields = {field: self._of(node) for field, node in self._fields[kind][1]}
            self._made[kind] = make_idl_struct(name, f"{package}.msg.dds_.{name}_", fields)
        return self._made[kind]

    def _of(self, node: tuple[Any, Any]) -> Any:
        kind, what = node
        if kind == Nodetype.BASE:
            return _BASES.get(what[0]) or getattr(types, what[0])
        if kind == Nodetype.NAME:
            return self.type(what)
        inner: Any = self._of(what[0])
        array: Any = types.array
        sequence: Any = types.sequence
        return array[inner, what[1]] if kind == Nodetype.ARRAY else sequence[inner]

    def filled(self, node: tuple[Any, Any], value: Any) -> Any:
        """What a field of a message holds: the value, and zeros where it says nothing."""
        kind, what = node
        if kind == Nodetype.BASE:
            empty: Any = {"bool": False, "string": ""}.get(what[0], 0)
            return empty if value is None else value
        if kind == Nodetype.NAME:
            given = value or {}
            fields = self._fields[what][1]
            assert not set(given) - {name for name, _ in fields}, f"{what} has no {set(given)}"
            return self.type(what)(**{name: self.filled(one, given.get(name)) for name, one in fields})
        if kind == Nodetype.ARRAY:
            return [self.filled(what[0], None)] * what[1] if value is None else value
        return [self.filled(what[0], one) for one in value or []]


class Peer:
    """Publishes the last message of each topic again and again, records topics, calls services."""

    def __init__(self) -> None:
        self._messages = Messages()
        self._participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self._lock = threading.Lock()
        self._writers: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}
        self._readers: dict[str, Any] = {}
        self._recorded: dict[str, list[Any]] = {}
        threading.Thread(target=self._repeat, daemon=True).start()

    def _repeat(self) -> None:
        while True:
            with self._lock:
                for topic, message in self._sent.items():
                    self._writers[topic].write(message)
                for topic, reader in self._readers.items():
                    self._take(topic, reader)
            time.sleep(0.02)

    def _take(self, topic: str, reader: Any) -> None:
        for sample in reader.take(1000):
            if sample.sample_info.valid_data:
                self._recorded[topic].append(_plain(sample))

    def publish(self, topic: str, kind: str, message: Any, reliable: bool = True) -> None:
        """Publish from now on."""
        with self._lock:
            if topic not in self._writers:
                place = Topic(self._participant, f"rt{topic}", self._messages.type(kind))
                self._writers[topic] = DataWriter(self._participant, place, qos=_qos(reliable))
            self._sent[topic] = self._messages.filled((Nodetype.NAME, kind), message)

    def silence(self, topic: str) -> None:
        """Publish no more."""
        with self._lock:
            del self._sent[topic]

    def record(self, topic: str, kind: str) -> None:
        """Record a topic; return when somebody publishes it."""
        place = Topic(self._participant, f"rt{topic}", self._messages.type(kind))
        reader = DataReader(self._participant, place, qos=_qos(True))
        deadline = time.monotonic() + 20
        while not reader.get_matched_publications():
            assert time.monotonic() < deadline, f"nobody publishes {topic}"
            time.sleep(0.005)
        with self._lock:
            self._recorded[topic] = []
            self._readers[topic] = reader

    def recorded(self, topic: str, after: int = 0) -> list[Any]:
        """What was published so far, from a place on."""
        with self._lock:
            self._take(topic, self._readers[topic])
            return self._recorded[topic][after:]

    def call(self, service: str) -> None:
        """Call a service without arguments, as rmw_cyclonedds does; return when it has answered."""
        asked, answer = _service("Empty_Request"), _service("Empty_Response")
        qos = _qos(True, 10, Policy.Userdata(b"clientid= 1.2.3;"))
        writer = DataWriter(
            self._participant, Topic(self._participant, f"rq{service}Request", asked), qos=qos
        )
        reader = DataReader(self._participant, Topic(self._participant, f"rr{service}Reply", answer), qos=qos)
        deadline = time.monotonic() + 20
        while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
            assert time.monotonic() < deadline, f"nobody offers {service}"
            time.sleep(0.005)
        writer.write(asked(77, 5, asked.data(0)))
        while True:
            assert time.monotonic() < deadline, f"{service} does not answer"
            for sample in reader.take(10):
                if sample.sample_info.valid_data and (sample.client, sample.sequence) == (77, 5):
                    return
            time.sleep(0.005)


def _service(name: str) -> Any:
    """A class for a request or a response without fields, with the header of rmw_cyclonedds."""
    typename = f"std_srvs.srv.dds_.{name}_"
    data = make_idl_struct(
        f"{name}_", f"{typename}Data_", {"structure_needs_at_least_one_member": types.uint8}
    )
    fields = {"client": types.uint64, "sequence": types.int64, "data": data}
    made: Any = make_idl_struct(f"{name}_", typename, fields)
    made.data = data
    return made


def _qos(reliable: bool, depth: int = 1000, *others: Any) -> Any:
    reliability = Policy.Reliability.Reliable(10**9) if reliable else Policy.Reliability.BestEffort
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(depth), *others)


def _plain(message: Any) -> Any:
    if isinstance(message, list | tuple):
        return [_plain(one) for one in message]
    names = getattr(message, "__dataclass_fields__", None)
    return message if names is None else {name: _plain(getattr(message, name)) for name in names}


def main() -> None:
    """Do as told until the input ends."""
    peer = Peer()
    for line in sys.stdin:
        what, arguments = json.loads(line)
        print(json.dumps(getattr(peer, what)(**arguments)), flush=True)


if __name__ == "__main__":
    main()
