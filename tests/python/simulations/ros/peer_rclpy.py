"""As `peer.py`, with rclpy: run by the Python of ROS 2, whose messages are those of its distribution."""

import json
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosidl_runtime_py import message_to_ordereddict, set_message_fields
from rosidl_runtime_py.utilities import get_message
from std_srvs.srv import Empty


class Peer:
    """Publishes the last message of each topic again and again, records topics, calls services."""

    def __init__(self) -> None:
        rclpy.init()
        self._node = rclpy.create_node("robot")
        self._publishers: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}
        self._recorded: dict[str, list[Any]] = {}
        self._node.create_timer(0.02, self._repeat)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        threading.Thread(target=self._executor.spin, daemon=True).start()

    def _repeat(self) -> None:
        for topic, message in list(self._sent.items()):
            self._publishers[topic].publish(message)

    def publish(self, topic: str, kind: str, message: Any, reliable: bool = True) -> None:
        """Publish from now on."""
        made = get_message(kind)()
        set_message_fields(made, message)
        if topic not in self._publishers:
            reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
            qos = QoSProfile(depth=10, reliability=reliability)
            self._publishers[topic] = self._node.create_publisher(type(made), topic, qos)
        self._sent[topic] = made

    def silence(self, topic: str) -> None:
        """Publish no more."""
        del self._sent[topic]

    def record(self, topic: str, kind: str) -> None:
        """Record a topic; return when somebody publishes it."""
        said = self._recorded[topic] = []
        self._node.create_subscription(
            get_message(kind), topic, lambda message: said.append(message_to_ordereddict(message)), 1000
        )
        deadline = time.monotonic() + 20
        while not self._node.count_publishers(topic):
            assert time.monotonic() < deadline, f"nobody publishes {topic}"
            time.sleep(0.005)

    def recorded(self, topic: str) -> list[Any]:
        """Return what was published so far."""
        return list(self._recorded[topic])

    def call(self, service: str) -> None:
        """Call a service without arguments; return when it has answered."""
        client = self._node.create_client(Empty, service)
        assert client.wait_for_service(20), f"nobody offers {service}"
        future = client.call_async(Empty.Request())
        deadline = time.monotonic() + 20
        while not future.done():
            assert time.monotonic() < deadline, f"{service} does not answer"
            time.sleep(0.005)


def main() -> None:
    """Do as told until the input ends."""
    peer = Peer()
    for line in sys.stdin:
        what, arguments = json.loads(line)
        print(json.dumps(getattr(peer, what)(**arguments)), flush=True)


if __name__ == "__main__":
    main()
