"""ROS 1 through rospy: see `middleware.Middleware`."""

from __future__ import annotations

import collections
import queue
import socket
import threading
import time
import warnings
import xmlrpc.client
from typing import Any, Callable, Mapping, Sequence
from urllib.parse import urlparse

import rosgraph
import rosgraph.network
import roslib.message
import rospy

from .mapping import short_type
from .middleware import MiddlewareError

_SLICE_S = 0.1


class Rospy:
    """A ROS 1 node. A process can have only one.

    Args:
        name: name of the node.
        use_sim_time: whether to read the time from `/clock`, which also needs the parameter /use_sim_time.
        patience: seconds to wait for the master.

    Raises MiddlewareError if no master answers.
    """

    def __init__(self, name: str, *, use_sim_time: bool = False, patience: float = 10.0) -> None:
        self.name, self._use_sim_time = name, use_sim_time
        _await_master(patience)
        try:
            rospy.init_node(name, anonymous=True, disable_signals=True)
        except (rospy.ROSException, OSError) as error:
            raise MiddlewareError(f"cannot become a node: {error}; is ROS_IP right?") from error
        self._come: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.full_name = str(rospy.get_name())
        self._master = rosgraph.Master(self.full_name)
        self._sending, self._ending = threading.Lock(), 0
        self._last: Callable[[], None] | None = None
        rospy.on_shutdown(self._end)  # called before connections are closed

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service. Raises ValueError with the reason."""
        if not rosgraph.names.is_legal_name(name):
            raise ValueError(f"'{name}' is not a valid name")
        return str(rospy.resolve_name(name if name.startswith(("/", "~")) else f"/{name}"))

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
        del reliable  # TCP is reliable
        full = self.resolve(topic)
        return _Subscription(rospy.Subscriber, full, _message(kind, full), self._come, callback, depth)

    def publisher(self, topic: str, kind: str, depth: int = 1) -> _Publisher:  # noqa: ARG002 - nothing waits
        """Advertise a topic. Raises MiddlewareError for an unknown type."""
        full = self.resolve(topic)
        return _Publisher(self, full, _message(kind, full))

    def client(self, service: str, kind: str) -> _Client:
        """Return a client for a service. Raises MiddlewareError for an unknown type."""
        full = self.resolve(service)
        return _Client(self, full, _service(kind, full))

    def service(self, name: str, kind: str, handler: Callable[[Any, Any], None]) -> None:
        """Offer a service; the handler fills in the response. Raises MiddlewareError for an unknown type."""
        full = self.resolve(name)
        service_class = _service(kind, full)

        def answer(request: Any) -> Any:
            response, done = service_class._response_class(), threading.Event()

            def run() -> None:
                handler(request, response)
                done.set()

            self._come.put(run)
            done.wait()
            return response

        rospy.Service(full, service_class, answer)

    def new(self, kind: str) -> Any:
        """Return a message with default values. Raises MiddlewareError for an unknown type."""
        return _message(kind, kind)()

    def set_parameters(self, namespace: str, values: Mapping[str, Any]) -> None:
        """Set parameters on the parameter server. Raises MiddlewareError if it does not answer."""
        try:
            for name, value in values.items():
                rospy.set_param(f"{namespace.rstrip('/')}/{name.replace('.', '/')}", value)
        except (OSError, rospy.ROSException, xmlrpc.client.Fault, OverflowError) as error:
            raise MiddlewareError(f"{namespace}: parameters cannot be set: {error}") from error

    def types(self, topic: str) -> Sequence[str]:
        """Return the type of a topic at the master; empty if no node publishes it."""
        full = self.resolve(topic)
        try:
            types_by_topic = self._master.getTopicTypes()
        except (OSError, rosgraph.MasterException):
            return ()
        return [kind for name, kind in types_by_topic if name == full and kind != "*"]

    def spin_once(self, timeout: float) -> None:
        """Run the callbacks of received messages; if there are none, wait for them, for at most 0.1 s."""
        try:
            self._come.get(timeout=max(0.0, min(timeout, _SLICE_S)) or 1e-6)()
            while True:
                self._come.get_nowait()()
        except queue.Empty:
            pass

    def wake(self) -> None:
        """Let `spin_once` return; may be called in any thread."""
        self._come.put(lambda: None)

    def now(self) -> float:
        """Return seconds of a monotonic clock, or with simulated time of `/clock`."""
        return float(rospy.get_time()) if self._use_sim_time else time.monotonic()

    def stamp(self, header: Any) -> None:
        """Write ROS time to a header."""
        header.stamp = rospy.Time.now()

    def say(self, level: str, text: str) -> None:
        """Log a line."""
        log: dict[str, Callable[[str], None]]
        log = {"info": rospy.loginfo, "warning": rospy.logwarn, "error": rospy.logerr}
        log[level](text)

    def on_shutdown(self, function: Callable[[], None]) -> None:
        """Set a function to call when the node is shut down from outside, while it can still publish."""
        self._last = function

    def _end(self) -> None:
        if self._last is None:
            return
        # A command of the other thread after the last command would stay in force.
        held = self._sending.acquire(timeout=1.0)
        self._ending = threading.get_ident()
        if held:
            self._sending.release()
        self._last()

    def send(self, end: Any, message: Any) -> None:
        """Publish a message. Raises MiddlewareError if the node was shut down."""
        if self._ending == threading.get_ident():
            end.publish(message)
            return
        with self._sending:
            if self._ending:
                raise MiddlewareError("the node was shut down")
            end.publish(message)

    def has_ended(self) -> bool:
        """Return whether the node was shut down, such as by `rosnode kill`."""
        return bool(self._ending) or bool(rospy.is_shutdown())

    def close(self) -> None:
        """Leave the graph after published messages have been sent."""
        self._last = None
        time.sleep(0.05)  # rospy cannot wait until messages have been sent
        rospy.signal_shutdown("done")


class _Subscription:
    """A topic that is received."""

    def __init__(
        self,
        kind: Any,
        topic: str,
        message: Any,
        come: queue.SimpleQueue[Callable[[], None]],
        callback: Callable[[Any], None],
        depth: int,
    ) -> None:
        self._waiting: collections.deque[Any] = collections.deque(maxlen=depth)
        self._come, self._callback = come, callback
        self.end = kind(topic, message, self._receive, tcp_nodelay=True)

    def _receive(self, message: Any) -> None:
        first = not self._waiting
        self._waiting.append(message)
        if first:
            self._come.put(self._pass_on)

    def _pass_on(self) -> None:
        while self._waiting:
            self._callback(self._waiting.popleft())

    def publishers(self) -> int:
        """Return how many publish on it and are connected."""
        return int(self.end.get_num_connections())

    def close(self) -> None:
        """Receive no more."""
        self.end.unregister()


class _Publisher:
    """A topic that is published on."""

    def __init__(self, node: Rospy, topic: str, message: Any) -> None:
        self._node, self._topic, self._message = node, topic, message
        with warnings.catch_warnings():
            # Without a queue messages are sent before a service is called that needs them.
            warnings.simplefilter("ignore")
            self.end = rospy.Publisher(topic, message, queue_size=None, tcp_nodelay=True)

    def new(self) -> Any:
        """Return a message with the defaults of its definition."""
        return self._message()

    def publish(self, message: Any) -> None:
        """Send a message. Raises MiddlewareError for a value that its field cannot hold."""
        try:
            self._node.send(self.end, message)
        except (rospy.ROSSerializationException, rospy.ROSException) as error:
            raise MiddlewareError(f"{self._topic}: cannot be published: {error}") from error

    def listeners(self) -> int:
        """Return how many subscriptions are connected."""
        return int(self.end.get_num_connections())


class _Client:
    """A service of another node."""

    def __init__(self, node: Rospy, name: str, kind: Any) -> None:
        self._node, self._name, self._kind = node, name, kind
        self._asker: _Asker | None = None

    def available(self) -> bool:
        """Return whether a server offers it."""
        probe = {"probe": "1", "md5sum": "*", "callerid": self._node.full_name, "service": self._name}
        try:
            uri = urlparse(self._node._master.lookupService(self._name))
            with socket.create_connection((uri.hostname or "", uri.port or 0), 1.0) as connection:
                # Without the handshake, the server would report a failed connection.
                rosgraph.network.write_ros_handshake_header(connection, probe)
                return True
        except (OSError, rosgraph.MasterException):
            return False

    def request(self) -> Any:
        """Return a request with the defaults of its definition."""
        return self._kind._request_class()

    def call(self, request: Any, timeout: float) -> Any:
        """Return the response. Raises TimeoutError, or MiddlewareError if the service failed."""
        deadline = time.monotonic() + timeout
        if self._asker is None:
            while not self.available():
                if time.monotonic() > deadline:
                    raise TimeoutError(f"{self._name}: no node offers this service")
                self._node.spin_once(0.05)
            self._asker = _Asker(self._name, self._kind, self._node.wake)
        self._asker.requests.put(request)
        while self._asker.answers.empty():
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0:
                self._forget()  # else its answer would be mistaken for the next request's
                raise TimeoutError(f"{self._name}: no answer within {timeout:g} s")
            self._node.spin_once(remaining_s)
        answer = self._asker.answers.get()
        if isinstance(answer, Exception):
            self._forget()  # a connection does not outlive a failure
            raise MiddlewareError(f"{self._name}: {answer}") from answer
        return answer

    def _forget(self) -> None:
        if self._asker is not None:
            self._asker.requests.put(None)
            self._asker = None


class _Asker:
    """A connection to a service in a separate thread, because rospy waits for answers indefinitely."""

    def __init__(self, name: str, kind: Any, answered: Callable[[], None]) -> None:
        self._proxy = rospy.ServiceProxy(name, kind, persistent=True)
        self._answered = answered
        self.requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
        """Requests; None ends the thread."""
        self.answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        """Responses, or exceptions."""
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        for request in iter(self.requests.get, None):
            try:
                answer: Any = self._proxy(request)
            except Exception as error:  # noqa: BLE001 - of rospy, or of a socket; raised in `call`
                answer = error
            self.answers.put(answer)
            self._answered()
        self._proxy.close()


def _await_master(patience: float) -> None:
    """Wait for the master with a time limit, which rospy does not have."""
    deadline = time.monotonic() + patience
    while not rosgraph.is_master_online():
        if time.monotonic() > deadline:
            raise MiddlewareError(
                f"no master answers at {rosgraph.get_master_uri()} (ROS_MASTER_URI); start roscore"
            )
        time.sleep(0.05)


def _message(kind: str, topic: str) -> Any:
    message_class = roslib.message.get_message_class(short_type(kind))
    if message_class is None:
        raise MiddlewareError(f"{topic}: the message type '{kind}' is not installed")
    return message_class


def _service(kind: str, name: str) -> Any:
    service_class = roslib.message.get_service_class(short_type(kind))
    if service_class is None:
        raise MiddlewareError(f"{name}: the service type '{kind}' is not installed")
    return service_class
