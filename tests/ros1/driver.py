"""A ROS node for tests, in Debian's Python: reads lines [what, arguments], answers each with one of JSON."""

import json
import sys
import threading
import time
import xmlrpc.client
from typing import Any

import genpy
import rosgraph
import roslib.message
import rospy
import std_srvs.srv


class Driver:
    """Publishes the last message of each topic again and again, and records topics."""

    def __init__(self) -> None:
        self._publishers: dict[str, Any] = {}
        self._messages: dict[str, Any] = {}
        self._recorded: dict[str, list[Any]] = {}
        self._subscribers: dict[str, Any] = {}
        threading.Thread(target=self._repeat, daemon=True).start()

    def _repeat(self) -> None:
        while True:
            for topic, message in list(self._messages.items()):
                self._publishers[topic].publish(message)
            time.sleep(0.02)

    def publish(self, topic: str, kind: str, message: Any) -> None:
        """Publish from now on."""
        made = roslib.message.get_message_class(kind)()
        genpy.message.fill_message_args(made, [message])
        if topic not in self._publishers:
            self._publishers[topic] = rospy.Publisher(topic, type(made), queue_size=1)
        self._messages[topic] = made

    def advertise(self, topic: str, kind: str) -> None:
        """Advertise without publishing."""
        made = roslib.message.get_message_class(kind)
        self._publishers[topic] = rospy.Publisher(topic, made, queue_size=1)

    def silence(self, topic: str) -> None:
        """Publish no more."""
        del self._messages[topic]

    def record(self, topic: str, kind: str) -> None:
        """Record a topic; return when somebody publishes it."""
        said = self._recorded[topic] = []
        self._subscribers[topic] = rospy.Subscriber(
            topic, roslib.message.get_message_class(kind), lambda message: said.append(_plain(message))
        )
        deadline = time.monotonic() + 20
        while not self._subscribers[topic].get_num_connections():
            if time.monotonic() > deadline:
                raise RuntimeError(f"nobody publishes {topic}")
            time.sleep(0.01)

    def recorded(self, topic: str) -> list[Any]:
        """Return what was published so far."""
        return list(self._recorded[topic])

    def forget(self, topic: str) -> None:
        """Record no longer."""
        self._subscribers.pop(topic).unregister()

    def set(self, name: str, value: Any) -> None:
        """Set a parameter."""
        rospy.set_param(name, value)

    def node(self, begin: str) -> str:
        """Return the name of the node whose name begins so."""
        state = rosgraph.Master("/driver").getSystemState()
        return str(next(one for kind in state for _, names in kind for one in names if one.startswith(begin)))

    def kill(self, node: str) -> None:
        """Tell a node to end, as `rosnode kill` does."""
        uri = rosgraph.Master("/driver").lookupNode(node)
        xmlrpc.client.ServerProxy(uri).shutdown("/driver", "killed by a test")

    def call(self, service: str) -> None:
        """Call a service without arguments."""
        rospy.wait_for_service(service, 20)
        rospy.ServiceProxy(service, std_srvs.srv.Empty)()


def _plain(message: Any) -> Any:
    if isinstance(message, genpy.Message):
        return {name: _plain(getattr(message, name)) for name in message.__slots__}
    if isinstance(message, list | tuple):
        return [_plain(one) for one in message]
    return message


def main() -> None:
    """Do as told until the input ends."""
    rospy.init_node("driver", disable_signals=True)
    driver = Driver()
    for line in sys.stdin:
        what, arguments = json.loads(line)
        print(json.dumps(getattr(driver, what)(**arguments)), flush=True)


if __name__ == "__main__":
    main()
