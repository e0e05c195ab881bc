"""ROS 2 through its own library for Python, rclpy."""

from __future__ import annotations

import importlib
import time
from typing import Any, Callable, Sequence

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from .mapping import short_type
from .middleware import MiddlewareError
from .names import resolve

_SLICE_S = 0.1


class Rclpy:
    """A node of rclpy; see `middleware.Middleware`.

    Args:
        node: an `rclpy.node.Node`, which is destroyed by `close`. Nothing else spins it.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._use_sim_time = bool(node.get_parameter("use_sim_time").value)
        self._ended = False

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with what is wrong."""
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
        """Have messages of a topic passed to a function. Raises MiddlewareError for an unknown type."""
        full = self.resolve(topic)
        qos = _qos(depth, ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)
        made = self._node.create_subscription(_found("msg", kind), full, callback, qos)
        return _Subscription(self._node, full, made)

    def publisher(self, topic: str, kind: str, depth: int = 1) -> _Publisher:
        """Advertise a topic. Raises MiddlewareError for an unknown type."""
        full, made = self.resolve(topic), _found("msg", kind)
        qos = _qos(depth, ReliabilityPolicy.RELIABLE)
        return _Publisher(made, self._node.create_publisher(made, full, qos))

    def client(self, service: str, kind: str) -> _Client:
        """Return what calls a service. Raises MiddlewareError for an unknown type."""
        full, made = self.resolve(service), _found("srv", kind)
        return _Client(self, full, short_type(kind), made, self._node.create_client(made, full))

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; the handler fills in the response. Raises MiddlewareError for an unknown type."""

        def answer(request: Any, response: Any) -> Any:
            handler(request, response)
            return response

        self._node.create_service(_found("srv", kind), self.resolve(name), answer)

    def new(self, kind: str) -> Any:
        """Return a message with the defaults of its definition; raises MiddlewareError for no type."""
        return _found("msg", kind)()

    def types(self, topic: str) -> Sequence[str]:
        """Return the types with which other nodes use a topic, as far as they have been discovered."""
        full = self.resolve(topic)
        own = (self._node.get_name(), self._node.get_namespace())
        found: list[Any] = [
            *self._node.get_publishers_info_by_topic(full),
            *self._node.get_subscriptions_info_by_topic(full),
        ]
        others = {
            publisher.topic_type
            for publisher in found
            if (publisher.node_name, publisher.node_namespace) != own
        }
        return sorted(map(short_type, others))

    def service_types(self, service: str) -> Sequence[str]:
        """Return the types with which other nodes offer a service, as far as they have been discovered."""
        known = dict(self._node.get_service_names_and_types())
        return sorted(map(short_type, known.get(self.resolve(service), ())))

    def spin_once(self, timeout: float) -> None:
        """Run the callback of something that has come; where nothing has, wait for it, for 0.1 s at most."""
        try:
            self._executor.spin_once(timeout_sec=max(0.0, min(timeout, _SLICE_S)))
        except ExternalShutdownException:
            self._ended = True

    def now(self) -> float:
        """Return seconds of a clock that never jumps; with simulated time those of `/clock`."""
        if not self._use_sim_time:
            return time.monotonic()
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def stamp(self, header: Any) -> None:
        """Write the time of ROS to a header."""
        header.stamp = self._node.get_clock().now().to_msg()

    def say(self, level: str, text: str) -> None:
        """Log a line."""
        # Each place in the source has one level: rclpy refuses a second one.
        if level == "error":
            self._node.get_logger().error(text)
        elif level == "warning":
            self._node.get_logger().warning(text)
        else:
            self._node.get_logger().info(text)

    def before_end(self, function: Callable[[], None]) -> None:
        """Do nothing: ROS 2 ends no node from outside."""

    def ended(self) -> bool:
        """Return whether ROS was shut down."""
        return self._ended or not self._node.context.ok()

    def close(self) -> None:
        """Leave the graph, a tenth of a second after the last message, so that it is sent."""
        if not self.ended():
            time.sleep(_SLICE_S)
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()


class _Subscription:
    """A topic that is received."""

    def __init__(self, node: Any, name: str, made: Any) -> None:
        self._node, self._name, self._made = node, name, made

    def publishers(self) -> int:
        """Return how many publish on it."""
        return int(self._node.count_publishers(self._name))

    def close(self) -> None:
        """Receive no more."""
        self._node.destroy_subscription(self._made)


class _Publisher:
    """A topic that is published on."""

    def __init__(self, kind: Any, made: Any) -> None:
        self._type, self._made = kind, made

    def new(self) -> Any:
        """Return a message with the defaults of its definition."""
        return self._type()

    def publish(self, message: Any) -> None:
        """Send a message."""
        self._made.publish(message)

    def listeners(self) -> int:
        """Return how many subscriptions receive it."""
        return int(self._made.get_subscription_count())


class _Client:
    """A service of another node."""

    def __init__(self, node: Rclpy, name: str, kind: str, made_of: Any, made: Any) -> None:
        self._node, self._name, self._kind, self._type, self._made = node, name, kind, made_of, made

    def available(self) -> bool:
        """Return whether a server offers it."""
        return bool(self._made.service_is_ready())

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
        future = self._made.call_async(request)
        while not future.done():
            left = deadline - time.monotonic()
            if left <= 0 or self._node.ended():
                self._made.remove_pending_request(future)
                raise TimeoutError(f"{self._name}: no answer within {timeout:g} s")
            self._node.spin_once(left)
        if future.exception() is not None:
            raise MiddlewareError(f"{self._name}: {future.exception()}")
        return future.result()

    def _absence(self) -> str:
        others = [name for name in self._node.service_types(self._name) if name != self._kind]
        return (
            f"the service has the type {others[0]}, not {self._kind}"
            if others
            else "no node offers this service"
        )


def _qos(depth: int, reliability: Any) -> Any:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


def _found(group: str, kind: str) -> Any:
    """Return the class of a type. Raises MiddlewareError when it is not installed."""
    package, _, name = short_type(kind).partition("/")
    try:
        return getattr(importlib.import_module(f"{package}.{group}"), name)
    except (ImportError, AttributeError) as error:
        raise MiddlewareError(
            f"the type '{kind}' is not installed: {error}; "
            f"install ros-$ROS_DISTRO-{package.replace('_', '-')}"
        ) from None
