"""Common interface of a node in ROS 1 and ROS 2: topics, services, a clock.

Types have the short form, `geometry_msgs/Twist`; names are resolved in the node's namespace. Callbacks and
handlers run only in the thread that calls `spin_once` or `Client.call`, which must not be called from a
callback. A subscription keeps only the latest message unless its depth is greater, so that a late node reads
current values.

In ROS 2, subscriptions are best effort and volatile by default, which is compatible with every publisher;
publishers are reliable and volatile.
"""

from __future__ import annotations

import re
from typing import Any, Callable, Protocol, Sequence

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def resolve(name: str, namespace: str = "/", node: str = "node") -> str:
    """Return the absolute name: `scan` in the namespace `/robot_1` is `/robot_1/scan`.

    Args:
        name: absolute (`/scan`), relative (`scan`), or private to the node (`~/steps`).
        namespace: namespace of the node, with or without the first `/`.
        node: its name, for private names.

    Raises ValueError, with the reason, if the name is not valid.
    """
    if not name:
        raise ValueError("the name is empty")
    inside = namespace.strip("/")
    if name.startswith("/"):
        full = name[1:]
    elif name == "~" or name.startswith("~/"):
        full = "/".join(filter(None, [inside, node])) + name[1:]
    else:
        full = f"{inside}/{name}" if inside else name
    for token in full.split("/"):
        if not token:
            raise ValueError("contains // or ends with /")
        if not _TOKEN.fullmatch(token):
            raise ValueError(
                f"'{token}' is not valid in a name: expected a letter or _, then letters, digits and _"
            )
    return f"/{full}"


def namespace_of(name: str) -> str:
    """Return a namespace in its full form: `robot_1` is `/robot_1`, an empty one `/`.

    Raises ValueError, with the reason, if the namespace is not valid.
    """
    inside = name.strip("/")
    return resolve(f"/{inside}") if inside else "/"


class MiddlewareError(Exception):
    """An operation of the middleware failed; the message has the topic or service and a remedy."""


class Publisher(Protocol):
    """A topic that is published on."""

    def new(self) -> Any:
        """Return a message with the defaults of its definition, nearly always zeros."""

    def publish(self, message: Any) -> None:
        """Send a message."""

    def listeners(self) -> int:
        """Return the number of subscriptions that have been discovered."""


class Subscription(Protocol):
    """A topic that is received."""

    def publishers(self) -> int:
        """Return the number of publishers that have been discovered."""

    def close(self) -> None:
        """Unsubscribe."""


class Client(Protocol):
    """A service of another node."""

    def available(self) -> bool:
        """Return whether a server has been discovered."""

    def request(self) -> Any:
        """Return a request with the defaults of its definition, nearly always zeros."""

    def call(self, request: Any, timeout: float) -> Any:
        """Return the response; callbacks of topics run meanwhile.

        timeout: seconds for discovery and answer together.

        Raises:
            TimeoutError: no server offers the service, or no answer came.
            MiddlewareError: the service failed.
        """


class Middleware(Protocol):
    """A node in the graph."""

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with the reason."""

    def subscribe(
        self,
        topic: str,
        kind: str,
        callback: Callable[[Any], None],
        depth: int = 1,
        *,
        reliable: bool = False,
    ) -> Subscription:
        """Subscribe to a topic; callback: called with each message.

        reliable: whether no message may be lost, even from a publisher that has just started, as for
            commands; best-effort publishers are then not received.

        Raises MiddlewareError for an unknown type.
        """

    def publisher(self, topic: str, kind: str, depth: int = 1) -> Publisher:
        """Advertise a topic.

        depth: messages that are kept for late subscriptions.

        Raises MiddlewareError for an unknown type.
        """

    def client(self, service: str, kind: str) -> Client:
        """Return a client for a service. Raises MiddlewareError for an unknown type."""

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; handler: called with the request and an empty response, which it fills in.

        Raises MiddlewareError for an unknown type.
        """

    def new(self, kind: str) -> Any:
        """Return a message with the defaults of its definition, for use in other messages."""

    def types(self, topic: str) -> Sequence[str]:
        """Return the types with which other nodes are known to use a topic, in the short form."""

    def spin_once(self, timeout: float) -> None:
        """Run the callbacks of received messages; if there are none, wait for them.

        timeout: seconds of real time, limited to 0.1 so that signals are handled.
        """

    def now(self) -> float:
        """Return seconds of a monotonic clock; with simulated time those of `/clock`, 0 before its start."""

    def stamp(self, header: Any) -> None:
        """Write ROS time to a header."""

    def say(self, level: str, text: str) -> None:
        """Log a line; level: `info`, `warning` or `error`."""

    def on_shutdown(self, function: Callable[[], None]) -> None:
        """Set a function to call when the node is shut down from outside, while it can still publish.

        This happens only in ROS 1: `rosnode kill`, or another node with the same name. The function is called
        in another thread, and this thread can no longer publish.
        """

    def has_ended(self) -> bool:
        """Return whether the middleware has shut the node down."""

    def close(self) -> None:
        """Leave the graph after published messages have been sent."""
