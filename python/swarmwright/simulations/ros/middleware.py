"""What a node needs from ROS, whichever it is: topics, services, a clock.

Types have their short spelling, `geometry_msgs/Twist`; names are resolved in the node's namespace. Callbacks
and handlers run in the thread that calls `spin_once` or `Client.call`, and in no other; neither of the two is
called from within a callback. A subscription keeps the latest message alone unless a greater depth is
asked for: a node that is late reads what is true now.

In ROS 2, subscriptions are best effort and volatile, which every publisher can serve, unless they are asked
to be reliable, and publishers are reliable and volatile, which every such subscription takes.
"""

from __future__ import annotations

from typing import Any, Callable, Protocol, Sequence


class MiddlewareError(Exception):
    """The middleware cannot do it; the message says what, on which topic or service, and how to repair it."""


class Publisher(Protocol):
    """A topic that is published on."""

    def new(self) -> Any:
        """Return a message with the defaults of its definition, nearly always zeros."""

    def publish(self, message: Any) -> None:
        """Send a message."""

    def listeners(self) -> int:
        """Return how many subscriptions receive it, as far as they have been discovered."""


class Subscription(Protocol):
    """A topic that is received."""

    def publishers(self) -> int:
        """Return how many publish on it, as far as they have been discovered."""

    def close(self) -> None:
        """Receive no more."""


class Client(Protocol):
    """A service of another node."""

    def available(self) -> bool:
        """Return whether a server offers it, as far as that has been discovered."""

    def request(self) -> Any:
        """Return a request with the defaults of its definition, nearly always zeros."""

    def call(self, request: Any, timeout: float) -> Any:
        """Return the response; callbacks of topics run meanwhile.

        timeout: seconds, for the service to be discovered and for its answer together.

        Raises:
            TimeoutError: no server offers the service, or no answer came; the message says which.
            MiddlewareError: the service failed.
        """


class Middleware(Protocol):
    """A node in the graph."""

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with what is wrong."""

    def subscribe(
        self,
        topic: str,
        kind: str,
        callback: Callable[[Any], None],
        depth: int = 1,
        *,
        reliable: bool = False,
    ) -> Subscription:
        """Have messages of a topic passed to a function.

        reliable: none is lost, as it must be where each of them asks for something, also from a publisher
            that has just come; publishers that are best effort are not heard then.

        Raises MiddlewareError for an unknown type.
        """

    def publisher(self, topic: str, kind: str, depth: int = 1) -> Publisher:
        """Advertise a topic.

        depth: messages that are kept for subscriptions that are late.

        Raises MiddlewareError for an unknown type.
        """

    def client(self, service: str, kind: str) -> Client:
        """Return what calls a service. Raises MiddlewareError for an unknown type."""

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; the handler gets the request and an empty response, which it fills in.

        Raises MiddlewareError for an unknown type.
        """

    def new(self, kind: str) -> Any:
        """Return a message with the defaults of its definition, to be put into others."""

    def types(self, topic: str) -> Sequence[str]:
        """Return the types with which other nodes use a topic, as far as known, in short spelling."""

    def spin_once(self, timeout: float) -> None:
        """Run the callbacks of what has come; where nothing has, wait for it.

        timeout: seconds of a real clock, at most 0.1 of which are waited, so that signals are seen.
        """

    def now(self) -> float:
        """Return seconds of a clock that never jumps; with simulated time those of `/clock`, 0 before it."""

    def stamp(self, header: Any) -> None:
        """Write the time of ROS to a header."""

    def say(self, level: str, text: str) -> None:
        """Log a line: level is `info`, `warning` or `error`."""

    def before_end(self, function: Callable[[], None]) -> None:
        """Have a function called when the node is told to end from outside, as long as it can publish.

        Only ROS 1 does that: `rosnode kill`, or another node of the name. It is called in another thread,
        and then this one can publish no more.
        """

    def ended(self) -> bool:
        """Return whether the node was told to end by the middleware."""

    def close(self) -> None:
        """Leave the graph, after what was published has been sent."""
