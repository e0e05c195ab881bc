"""Episodes of robots of a ROS system, step by step."""

from __future__ import annotations

import math
import subprocess
import time
from typing import Any, Callable, Iterator, Mapping, Sequence

from .expression import FUNCTIONS, Expression
from .fields import binary32, describe_missing_value, number_reader
from .mapping import SensorMapping, TopicField, read_mapping, resolve_topics
from .middleware import Middleware, namespace_of, resolve
from .simulation_interfaces import Simulation
from .topics import Outputs

_TOLERANCE = 1.1
"""Longest mean step of an episode without a warning, relative to its duration."""
_SHARE = 0.5
"""Share of the excess time that waits must account for to be named as the cause."""


class Pace:
    """The times between commands in an episode of robots that move continuously.

    Args:
        duration: duration of a step, in seconds.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self.begin()

    def begin(self) -> None:
        """Start an episode."""
        self._last: float | None = None
        self._seconds = 0.0
        self._steps = 0
        self._waits: dict[str, float] = {}
        self._remedies: dict[str, str] = {}

    def command(self, now: float) -> None:
        """Record that a command is sent; now: seconds of the clock for steps."""
        if self._last is not None and now >= self._last:  # /clock may have been reset
            self._seconds += now - self._last
            self._steps += 1
        self._last = now

    def rest(self) -> None:
        """Leave out the current step, as the robots stand still until the next."""
        self._last = None

    def wait(self, source: str, seconds: float, remedy: str) -> None:
        """Record a wait for a topic after the end of a step.

        source: the topic. seconds: duration of the wait, on the clock for steps. remedy: a remedy other than
        longer steps, in words.
        """
        if seconds <= 0:  # /clock may have been reset
            return
        self._waits[source] = self._waits.get(source, 0.0) + seconds
        self._remedies[source] = remedy

    def warning(self) -> str | None:
        """Return a warning about steps that took too long; None if there is no problem."""
        if not self._steps or self._seconds <= _TOLERANCE * self._duration * self._steps:
            return None
        text = (
            f"steps took {self._seconds / self._steps:.3g} s on average instead of {self._duration:g} s "
            f"(simulation.step), over {self._steps} steps; robots continued with the last command"
        )
        beyond = self._seconds - self._duration * self._steps
        if sum(self._waits.values()) < _SHARE * beyond:
            return f"{text}; this machine is too slow or too busy: make steps longer"
        slowest = max(self._waits, key=lambda source: self._waits[source])
        return (
            f"{text} while they waited, most of the time for {slowest}; make steps longer, or "
            f"{self._remedies[slowest]}"
        )


class Value:
    """A number on a topic.

    Args:
        name: name for messages, such as `sensor left`.
        entry: the number's field, with its resolved topic.
        single: whether to round to binary32, the type of a controller's sensors.
        keeps: seconds of real time for which a value is valid, even in later steps; 0: only in its step,
            infinite: always.
        otherwise: the value before the first message; None: a message is required.
        remedy: how to avoid waiting for messages, in words.
    """

    def __init__(
        self,
        name: str,
        entry: SensorMapping,
        *,
        single: bool,
        keeps: float = 0.0,
        otherwise: float | None = None,
        remedy: str = "",
    ) -> None:
        self.name, self.entry, self.keeps, self._otherwise = name, entry, keeps, otherwise
        self.remedy = remedy
        self.number = math.nan if otherwise is None else otherwise
        self.came: float | None = None
        """Time of the latest value, on a real clock."""
        self.strange: str | None = None
        """A value in this step that is not finite; empty if a message had no value."""
        self._read = number_reader(entry)
        self._single = single

    def begin(self) -> None:
        """Start a step."""
        self.strange = None
        if not self.keeps:
            self.came = None

    def forget(self) -> None:
        """Start an episode."""
        self.came = self.strange = None
        self.number = math.nan if self._otherwise is None else self._otherwise

    def take(self, message: Any, now: float) -> None:
        """Read a message."""
        value = self._read(message)
        number = value if value is None or not self._single else binary32(value)
        if number is None or not math.isfinite(number):
            self.strange = "" if value is None else f"{value:g}"
            return
        self.number, self.came, self.strange = number, now, None

    def is_there(self, now: float) -> bool:
        """Return whether the value is valid."""
        if self.came is None:
            return self._otherwise is not None
        return self.keeps == 0.0 or now - self.came <= self.keeps


class Feed:
    """A topic and the values that are read from it."""

    def __init__(self, node: Middleware, topic: str, kind: str, depth: int) -> None:
        self.topic, self.kind, self._node = topic, kind, node
        self.values: list[Value] = []
        self.count = 0
        """Number of messages in the step."""
        self._subscription = node.subscribe(topic, kind, self._receive, depth)

    def __str__(self) -> str:
        return f"{self.topic} ({self.kind}; {', '.join(value.name for value in self.values)})"

    @property
    def remedy(self) -> str:
        """How to avoid waiting for messages, in words."""
        remedies = [value.remedy for value in self.values if math.isfinite(value.keeps)]
        return " and ".join(dict.fromkeys(remedies))

    @property
    def needed(self) -> bool:
        """Whether a message is required."""
        return not all(value.is_there(math.inf) for value in self.values)

    def begin(self) -> None:
        """Begin a step."""
        self.count = 0
        for value in self.values:
            value.begin()

    def forget(self) -> None:
        """Begin an episode."""
        self.count = 0
        for value in self.values:
            value.forget()

    def publishers(self) -> int:
        """Return the number of publishers of the topic."""
        return self._subscription.publishers()

    def wrong_type(self) -> str | None:
        """Return a different type with which other nodes use the topic; None if there is none."""
        return next((name for name in self._node.types(self.topic) if name != self.kind), None)

    def is_complete(self, messages: int, now: float) -> bool:
        """Return whether all values are valid.

        messages: number of messages required in the step, unless values of earlier steps are valid.
        """
        if not all(value.is_there(now) for value in self.values):
            return False
        return self.count >= messages or all(value.keeps for value in self.values)

    def explain_missing(self, messages: int, now: float, seconds: float) -> str:
        """Return why the feed is not complete."""
        where = f"{self.topic} ({self.kind})"
        other_type = self.wrong_type()
        if other_type is not None:
            return f"{self.topic} has the type {other_type}, but the definition says {self.kind}"
        for value in self.values:
            if value.strange is not None and not value.is_there(now):
                problem = f"{value.strange} came for {seconds:g} s, expected a finite number"
                if not value.strange:
                    problem = f"messages came for {seconds:g} s, but {describe_missing_value(value.entry)}"
                return f"{where}: {value.name}: {problem}"
        names = ", ".join(value.name for value in self.values)
        if not self.publishers():
            return f"{where}: no node publishes it; {names} cannot be read"
        if 0 < self.count < messages:
            return (
                f"{where}: {self.count} messages came within {seconds:g} s, expected {messages} "
                f"(simulation.step.messages); {names}"
            )
        return f"{where}: nothing came for {seconds:g} s; {names}"

    def _receive(self, message: Any) -> None:
        self.count += 1
        now = time.monotonic()
        for value in self.values:
            value.take(message, now)


class Feeds:
    """All received topics, each subscribed once."""

    def __init__(self, node: Middleware, messages: int) -> None:
        self._node, self._messages = node, messages
        self.all: list[Feed] = []

    def add(self, value: Value) -> Value:
        """Add a value to read; return it."""
        field = value.entry.topic_field
        feed = next((subscription for subscription in self.all if subscription.topic == field.topic), None)
        if feed is None:
            feed = Feed(self._node, field.topic, field.type, max(10, 2 * self._messages))
            self.all.append(feed)
        feed.values.append(value)
        return value

    def begin(self) -> None:
        """Start a step; earlier messages are ignored."""
        for feed in self.all:
            feed.begin()

    def forget(self) -> None:
        """Begin an episode."""
        for feed in self.all:
            feed.forget()

    def missing(self, messages: int | None = None) -> list[Feed]:
        """Return the topics that are not complete in the step."""
        now = time.monotonic()
        needed_messages = self._messages if messages is None else messages
        return [feed for feed in self.all if not feed.is_complete(needed_messages, now)]


_SEED = 1 << 31
_SETTLE_S = 0.2
"""Seconds after the first connections, until other nodes have discovered them."""
_DRAIN_S = 0.05
"""Seconds for messages that a reset may have published."""


class Failure(Exception):  # noqa: N818 - an episode has failed, the program has not
    """An episode has failed; the message has a remedy."""


class _Metric:
    """A metric of an episode."""

    def __init__(self, definition: Mapping[str, Any]) -> None:
        self._over_time = FUNCTIONS[definition["time"]]
        self._over_robots = FUNCTIONS[definition["robots"]]
        self.sources: list[Callable[[], float]] = []
        """Sources for each robot, or a single source for all."""
        self._values: list[list[float]] = []

    def begin(self) -> None:
        """Start an episode."""
        self._values = [[] for _ in self.sources]

    def sample(self) -> None:
        """Read the values of a step."""
        for values, source in zip(self._values, self.sources):
            values.append(source())

    def value(self) -> float:
        """Return the metric so far."""
        return float(self._over_robots([self._over_time(values) for values in self._values]))


class Robots:
    """The connected robots.

    Args:
        definition: the attachment.
        node: the node that connects to ROS.
        check: called during waits; its exceptions end the wait.
    """

    def __init__(self, definition: Mapping[str, Any], node: Middleware, check: Callable[[], None]) -> None:
        self._definition, self._node, self._check = definition, node, check
        self._step, self._reset = definition["step"], definition["reset"]
        self._patience, self._startup = float(definition["patience"]), float(definition["startup"])
        self._steps = int(definition["steps"])
        self.moves_alone = self._step["duration"] is not None
        """Whether robots move continuously, even between steps."""
        self._names: list[str] = list(definition["robots"])
        self._feeds = Feeds(node, int(self._step["messages"]))
        self._sensors: list[list[Value]] = []
        self._outputs: list[Outputs] = []
        self._simulation = Simulation(node, definition)
        self._triggers = {
            name: node.client(section["service"], section["type"])
            for name, section in (("step", self._step), ("reset", self._reset))
            if section["service"] is not None and section["type"].startswith("std_srvs/")
        }
        for robot in self._names:
            self._connect(robot)
        self._metrics = {name: self._metric(name, metric) for name, metric in definition["metrics"].items()}
        done = definition["done"]
        self._done = None if done is None else Expression(done)
        self._spawned = self._connected = False
        self._steps_made = 0
        self._due = 0.0
        self._pace = Pace(float(self._step["duration"] or 0.0))
        self._warned = False

    # Connections.

    def _connect(self, robot: str) -> None:
        definition = self._definition
        names = [sensor["sensor"] for sensor in definition["sensors"]]
        mapping = read_mapping(
            {"rate": 1, "sensors": definition["sensors"], "actuators": definition["actuators"]},
            names,
            [actuator["actuator"] for actuator in definition["actuators"]],
        )
        mapping = resolve_topics(mapping, lambda topic: _topic(topic, robot))
        timeouts = {sensor["sensor"]: sensor.get("timeout", 0.0) for sensor in definition["sensors"]}
        self._sensors.append(
            [
                self._feeds.add(
                    Value(
                        f"sensor {name}",
                        entry,
                        single=True,
                        keeps=timeouts[name] if self.moves_alone else 0.0,
                        remedy="give slow sensors a timeout",
                    )
                )
                for name, entry in zip(names, mapping.sensors)
            ]
        )
        self._outputs.append(Outputs(self._node, mapping.actuators))

    def _metric(self, name: str, definition: Mapping[str, Any]) -> _Metric:
        metric_, field = _Metric(definition), dict(definition["place"])
        if "sensor" in field:
            at = [sensor["sensor"] for sensor in self._definition["sensors"]].index(field["sensor"])
            scale, offset = field.get("scale", 1.0), field.get("offset", 0.0)
            for sensors in self._sensors:
                metric_.sources.append(_scale(sensors[at], scale, offset))
        elif "service" in definition:
            entry = _entry(name, {**field, "topic": definition["service"]})
            names = [definition["entity"].replace("{robot}", robot.strip("/")) for robot in self._names]
            for entity in dict.fromkeys(names):
                metric_.sources.append(self._simulation.state(definition["service"], entity, entry))
        else:
            topics = [_topic(field["topic"], robot) for robot in self._names]
            otherwise = definition.get("otherwise")
            for topic in dict.fromkeys(topics):
                value = Value(
                    f"metric {name}",
                    _entry(name, {**field, "topic": topic}),
                    single=False,
                    keeps=0.0 if otherwise is None else math.inf,
                    otherwise=otherwise,
                    remedy="give slow metrics a value otherwise",
                )
                metric_.sources.append(_scale(self._feeds.add(value), 1.0, 0.0))
        return metric_

    def _await_services(self) -> None:
        """Wait for services; a missing one is reported by the call that needs it."""
        deadline = time.monotonic() + self._startup
        clients = [*self._triggers.values(), *self._simulation.needed]
        while not all(client.available() for client in clients) and time.monotonic() < deadline:
            self._check()
            self._node.spin_once(0.05)

    def _await_connections(self) -> None:
        """Wait until all topics of the definition are connected."""
        deadline = time.monotonic() + self._startup
        while (missing := next(self._absent(), None)) is not None:
            self._check_types()
            if time.monotonic() > deadline:
                raise Failure(f"{missing} after {self._startup:g} s (simulation.startup)")
            self._check()
            self._node.spin_once(0.05)
        self._check_types()
        if not self._connected:
            self._spin(_SETTLE_S)
            self._connected = True

    def _check_types(self) -> None:
        """Raise Failure for a topic that other nodes use with another type."""
        for feed in self._feeds.all:
            other_type = feed.wrong_type()
            if other_type is not None:
                raise Failure(f"{feed.topic} has the type {other_type}, but the definition says {feed.kind}")
        for outputs in self._outputs:
            outputs.check_types()

    def _absent(self) -> Iterator[str]:
        for feed in self._feeds.all:
            if feed.needed and not feed.publishers():
                names = ", ".join(value.name for value in feed.values)
                yield f"no node publishes {feed.topic} ({feed.kind}), for {names},"
        for outputs in self._outputs:
            for topic, kind, publisher in outputs.publishers:
                if not publisher.listeners():
                    yield f"no node subscribes to {topic} ({kind})"

    # Episodes.

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Start an episode; return the answer."""
        self.stop()
        self._feeds.forget()
        self._set_parameters(parameters, seed)
        if not self._connected:
            self._await_services()
        if self._definition["spawn"] is None:
            self._await_connections()
        self._reset_once(parameters, seed)
        self._simulation.pause(self._patience)
        self._await_connections()
        self._settle()
        self._steps_made = 0
        self._due = self._node.now()
        self._pace.begin()
        for metric in self._metrics.values():
            metric.begin()
        self._sample()
        return self._answer()

    def step(self, actuators: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Advance by one step; return the answer."""
        for outputs, row in zip(self._outputs, actuators):
            outputs.publish(row)
        if self.moves_alone:
            self._pace.command(self._node.now())
            self._feeds.begin()
            self._pass_time(float(self._step["duration"]))
        else:
            self._call_step()
        self._await_feeds()
        self._steps_made += 1
        self._sample()
        return self._answer()

    def stop(self) -> None:
        """Stop all robots."""
        for outputs in self._outputs:
            outputs.stop()

    def rest(self) -> None:
        """Restart the timing, after robots were stopped between steps."""
        self._due = self._node.now()
        self._pace.rest()

    def _answer(self) -> dict[str, Any]:
        if self._steps_made >= self._steps or self._is_done():
            self.stop()
            metrics = {name: metric.value() for name, metric in self._metrics.items()}
            return {"done": True, "metrics": metrics, **self._warning()}
        if not self._sensors[0]:
            return {"sensors": [[0.0] for _ in self._names], "acting": []}
        return {"sensors": [[value.number for value in row] for row in self._sensors]}

    def _warning(self) -> dict[str, str]:
        """Return a warning for the answer that ends the first episode whose steps took too long."""
        if not self.moves_alone or self._warned:
            return {}
        self._pace.command(self._node.now())
        warning = self._pace.warning()
        self._warned = warning is not None
        return {} if warning is None else {"warning": warning}

    def _is_done(self) -> bool:
        if self._done is None:
            return False
        values = {name: metric.value() for name, metric in self._metrics.items()}
        try:
            return bool(self._done(values))
        except (ArithmeticError, ValueError) as error:
            raise Failure(f"simulation.done: {self._done.text}: {error}") from error

    def _sample(self) -> None:
        self._simulation.ask(self._patience)
        for metric in self._metrics.values():
            metric.sample()

    def _set_parameters(self, parameters: Mapping[str, Any], seed: int) -> None:
        node = self._reset["parameters"]
        if node is None:
            return
        values = {**parameters, "seed": seed % _SEED}
        if self._definition["ros"] == 1:
            self._node.set_parameters(node, values)  # type: ignore[attr-defined] # of rospy
        else:
            self._simulation.set_parameters(node, values, self._startup)

    def _reset_once(self, parameters: Mapping[str, Any], seed: int) -> None:
        reset = self._reset
        wait = self._patience
        if not self.moves_alone:
            self._feeds.begin()  # messages published by the reset are used
        if "reset" in self._triggers:
            self._trigger("reset", wait)
        elif reset["service"] is not None:
            self._simulation.reset(int(reset["scope"]), wait)
        if reset["command"] is not None:
            # These override parameters, so that a peer cannot set {here} and {port}.
            values = {**parameters, **self._definition["values"], "seed": seed}
            _run([_fill_word(word, values) for word in reset["command"]], self._startup)
        spawn = self._definition["spawn"]
        if spawn is not None and (reset["despawns"] or not self._spawned):
            self._simulation.spawn(
                spawn, self._names, seed, wait=self._startup, may_exist=not reset["despawns"]
            )
            self._spawned = True

    def _settle(self) -> None:
        settle = int(self._reset["settle"])
        if settle:
            self._spin(_DRAIN_S)
            for _ in range(settle):
                self.stop()
                if self.moves_alone:
                    self._spin(float(self._step["duration"]))
                else:
                    self._call_step()
                    self._await_feeds()
            if self.moves_alone:
                self._feeds.begin()
        elif self.moves_alone:
            self._feeds.begin()
        self._await_feeds(1)

    def _call_step(self) -> None:
        if self._step["delay"]:
            self._spin(float(self._step["delay"]))
        self._node.spin_once(0.0)
        self._feeds.begin()
        if "step" in self._triggers:
            self._trigger("step", self._patience)
        else:
            self._simulation.step(int(self._step["steps"]), self._patience)

    def _trigger(self, name: str, wait: float) -> None:
        client, section = self._triggers[name], self._reset if name == "reset" else self._step
        response = client.call(client.request(), wait)
        if section["type"] == "std_srvs/Trigger" and not response.success:
            why = response.message or "no reason"
            raise Failure(f"{section['service']} ({section['type']}) reports a failure: {why}")

    def _pass_time(self, duration: float) -> None:
        """Wait until the end of the step, without accumulating drift."""
        now = self._node.now()
        self._due = self._due + duration if 0 <= now - self._due < duration else now + duration
        moved, last = time.monotonic(), now
        while True:
            now = self._node.now()
            if now >= self._due or now < last - duration:
                return
            if now > last:
                moved, last = time.monotonic(), now
            if time.monotonic() - moved > self._patience:
                raise Failure(
                    f"/clock stands still at {now:g} s for {self._patience:g} s; is the simulation paused? "
                    "simulation.step.clock: wall counts real seconds"
                )
            self._check()
            self._node.spin_once(min(self._due - now, 0.05))

    def _await_feeds(self, messages: int | None = None) -> None:
        begin, first = time.monotonic(), self._node.now()
        late: Feed | None = None
        while True:
            missing = self._feeds.missing(messages)
            if not missing:
                if late is not None and messages is None:
                    self._pace.wait(str(late), self._node.now() - first, late.remedy)
                return
            late = missing[0]
            waited = time.monotonic() - begin
            if waited > self._patience:
                now = time.monotonic()
                needed_messages = int(self._step["messages"]) if messages is None else messages
                reason = missing[0].explain_missing(needed_messages, now, self._patience)
                more = f" (and {len(missing) - 1} more topics)" if len(missing) > 1 else ""
                raise Failure(f"{reason}{more}{self._hint()}")
            self._check()
            self._node.spin_once(0.05)

    def _hint(self) -> str:
        if not self._steps_made and not self.moves_alone and not self._reset["settle"]:
            return "; if the simulator publishes only during steps, set simulation.reset.settle: 1"
        return ""

    def _spin(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            self._check()
            self._node.spin_once(left)


def _scale(value: Value, scale: float, offset: float) -> Callable[[], float]:
    return lambda: value.number * scale + offset


def _topic(topic: str, robot: str) -> str:
    return resolve(topic.replace("{robot}", robot.strip("/").replace("/", "_")), namespace_of(robot))


def _entry(name: str, field: Mapping[str, Any]) -> SensorMapping:
    """Return the entry of a metric with a resolved topic."""
    topic, values = field["topic"], {**field, "sensor": name, "topic": "x"}
    entry = read_mapping({"rate": 1, "sensors": [values], "actuators": []}, [name], []).sensors[0]
    where = TopicField(f"metrics.{name}", topic, entry.topic_field.type, entry.topic_field.field)
    return SensorMapping(**{**vars(entry), "topic_field": where})


def _fill_word(parts: Sequence[Any], values: Mapping[str, Any]) -> str:
    """Join the parts of a word, which are text or {"name": name of a value}."""
    return "".join(part if isinstance(part, str) else _plain(values, part["name"]) for part in parts)


def _plain(values: Mapping[str, Any], name: str) -> str:
    if name not in values:
        raise Failure(f"simulation.reset.command: {{{name}}}: no parameter has this name")
    value = values[name]
    return str(value).lower() if isinstance(value, bool) else str(value)


def _run(words: Sequence[str], seconds: float) -> None:
    """Run the reset command."""
    try:
        done = subprocess.run(words, timeout=seconds, stdin=subprocess.DEVNULL, check=False)
    except OSError as error:
        raise Failure(f"simulation.reset.command: {words[0]}: {error.strerror}") from error
    except subprocess.TimeoutExpired as error:
        raise Failure(
            f"simulation.reset.command: {words[0]} has not ended after {seconds:g} s (simulation.startup)"
        ) from error
    if done.returncode:
        raise Failure(f"simulation.reset.command: {words[0]} ended with exit status {done.returncode}")
