"""ROS 2 through its own library for Python, rclpy."""

from __future__ import annotations

import importlib
import time
from typing import Any, Callable, Sequence

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from .mapping import short_type
from .middleware import MiddlewareError, resolve

_SLICE_S = 0.1


class Rclpy:
    """A node of rclpy; see `middleware.Middleware`.

    Args:
        node: an `rclpy.node.Node`, which `close` destroys. It must not be spun elsewhere.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._use_sim_time = bool(node.get_parameter("use_sim_time").value)
        self._ended = False

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with the reason."""
        return resolve(name, self._node.get_namespace(), self._node.get_name())

    def subscribe(
        self,
        topic: str,
        kind: str,
        callback: Callable[[Any], None],
        depth: int = 1,
        *,
        reliable: bool = False,
    ) -> _Subscription:
        """Subscribe to a topic. Raises MiddlewareError for an unknown type."""
        full = self.resolve(topic)
        qos = _qos(depth, ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)
        subscription = self._node.create_subscription(_import_type("msg", kind), full, callback, qos)
        return _Subscription(self._node, full, subscription)

    def publisher(self, topic: str, kind: str, depth: int = 1) -> _Publisher:
        """Advertise a topic. Raises MiddlewareError for an unknown type."""
        full, message_class = self.resolve(topic), _import_type("msg", kind)
        qos = _qos(depth, ReliabilityPolicy.RELIABLE)
        return _Publisher(message_class, self._node.create_publisher(message_class, full, qos))

    def client(self, service: str, kind: str) -> _Client:
        """Return a client for a service. Raises MiddlewareError for an unknown type."""
        full, service_class = self.resolve(service), _import_type("srv", kind)
        return _Client(
            self, full, short_type(kind), service_class, self._node.create_client(service_class, full)
        )

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; the handler fills in the response. Raises MiddlewareError for an unknown type."""

        def answer(request: Any, response: Any) -> Any:
            handler(request, response)
            return response

        self._node.create_service(_import_type("srv", kind), self.resolve(name), answer)

    def new(self, kind: str) -> Any:
        """Return a message with default values. Raises MiddlewareError for an unknown type."""
        return _import_type("msg", kind)()

    def types(self, topic: str) -> Sequence[str]:
        """Return the types with which discovered nodes use a topic."""
        full = self.resolve(topic)
        own_name = (self._node.get_name(), self._node.get_namespace())
        endpoints: list[Any] = [
            *self._node.get_publishers_info_by_topic(full),
            *self._node.get_subscriptions_info_by_topic(full),
        ]
        types_ = {
            publisher.topic_type
            for publisher in endpoints
            if (publisher.node_name, publisher.node_namespace) != own_name
        }
        return sorted(map(short_type, types_))

    def service_types(self, service: str) -> Sequence[str]:
        """Return the types with which discovered nodes offer a service."""
        types_by_service = dict(self._node.get_service_names_and_types())
        return sorted(map(short_type, types_by_service.get(self.resolve(service), ())))

    def spin_once(self, timeout: float) -> None:
        """Run the callback of a received message; if there is none, wait for one, for at most 0.1 s."""
        try:
            self._executor.spin_once(timeout_sec=max(0.0, min(timeout, _SLICE_S)))
        except ExternalShutdownException:
            self._ended = True

    def now(self) -> float:
        """Return seconds of a monotonic clock, or with simulated time of `/clock`."""
        if not self._use_sim_time:
            return time.monotonic()
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def stamp(self, header: Any) -> None:
        """Write ROS time to a header."""
        header.stamp = self._node.get_clock().now().to_msg()

    def say(self, level: str, text: str) -> None:
        """Log a line."""
        # rclpy refuses different levels in the same line of source.
        if level == "error":
            self._node.get_logger().error(text)
        elif level == "warning":
            self._node.get_logger().warning(text)
        else:
            self._node.get_logger().info(text)

    def on_shutdown(self, function: Callable[[], None]) -> None:
        """Do nothing, as ROS 2 does not shut nodes down from outside."""

    def has_ended(self) -> bool:
        """Return whether ROS was shut down."""
        return self._ended or not self._node.context.ok()

    def close(self) -> None:
        """Leave the graph after 0.1 s, so that the last message is sent."""
        if not self.has_ended():
            time.sleep(_SLICE_S)
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()


class _Subscription:
    """A topic that is received."""

    def __init__(self, node: Any, name: str, subscription: Any) -> None:
        self._node, self._name, self._subscription = node, name, subscription

    def publishers(self) -> int:
        """Return the number of publishers on the topic."""
        return int(self._node.count_publishers(self._name))

    def close(self) -> None:
        """Receive no more."""
        self._node.destroy_subscription(self._subscription)


class _Publisher:
    """A topic that is published on."""

    def __init__(self, kind: Any, publisher: Any) -> None:
        self._type, self._publisher = kind, publisher

    def new(self) -> Any:
        """Return a message with the defaults of its definition."""
        return self._type()

    def publish(self, message: Any) -> None:
        """Send a message."""
        self._publisher.publish(message)

    def listeners(self) -> int:
        """Return how many subscriptions receive it."""
        return int(self._publisher.get_subscription_count())


class _Client:
    """A service of another node."""

    def __init__(self, node: Rclpy, name: str, kind: str, service_class: Any, client: Any) -> None:
        self._node, self._name, self._kind, self._type, self._client = node, name, kind, service_class, client

    def available(self) -> bool:
        """Return whether a server offers it."""
        return bool(self._client.service_is_ready())

    def request(self) -> Any:
        """Return a request with the defaults of its definition."""
        return self._type.Request()

    def call(self, request: Any, timeout: float) -> Any:
        """Return the response. Raises TimeoutError when no server offers the service, or no answer came."""
        deadline = time.monotonic() + timeout
        while not self.available():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{self._name}: {self._absence()}")
            self._node.spin_once(min(0.01, timeout))
        future = self._client.call_async(request)
        while not future.done():
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0 or self._node.has_ended():
                self._client.remove_pending_request(future)
                raise TimeoutError(f"{self._name}: no answer within {timeout:g} s")
            self._node.spin_once(remaining_s)
        if future.exception() is not None:
            raise MiddlewareError(f"{self._name}: {future.exception()}")
        return future.result()

    def _absence(self) -> str:
        other_types = [name for name in self._node.service_types(self._name) if name != self._kind]
        return (
            f"the service has the type {other_types[0]}, not {self._kind}"
            if other_types
            else "no node offers this service"
        )


def _qos(depth: int, reliability: Any) -> Any:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


def _import_type(group: str, kind: str) -> Any:
    """Import the class of a type. Raises MiddlewareError if it is not installed."""
    package, _, name = short_type(kind).partition("/")
    try:
        return getattr(importlib.import_module(f"{package}.{group}"), name)
    except (ImportError, AttributeError) as error:
        raise MiddlewareError(
            f"the type '{kind}' is not installed: {error}; "
            f"install ros-$ROS_DISTRO-{package.replace('_', '-')}"
        ) from None
