"""Control of a robot by a controller at a fixed rate, with the topics of a mapping."""

from __future__ import annotations

import signal
import time
from typing import Any, Callable, Protocol, Sequence

from .mapping import Mapping, MappingError, read_mapping, resolve_topics
from .middleware import Middleware, MiddlewareError
from .topics import Inputs, Missing, Outputs

NAME = "swarmwright_controller"
"""Name of a node that runs an exported controller."""
_SAY_EVERY_S = 10.0
_SAY_CHANGE_S = 1.0
_LOOK_EVERY_S = 1.0
_STILL_S = 2.0
_REPEAT_S = 0.5
_STEPS_DEPTH = 1000
_EVENTS_DEPTH = 10
_DEEPEST = 10
"""Largest number of levels of nesting in a mapping."""


class Controller(Protocol):
    """Interface of an exported controller."""

    def reset(self) -> None:
        """Reset the state, for a new episode."""

    def step(self, sensors: Sequence[float]) -> Sequence[float]:
        """Return the actuators for one control cycle."""


class Control:
    """A controller on a robot.

    In every cycle it publishes a command: the controller's actuators, or zeros while a sensor is silent. It
    also publishes the sensors and actuators of each step on `~/steps` if there are subscribers, and starts an
    episode on a call of the service `~/reset` or a message on the topic `~/reset`.

    Args:
        node: a node in the robot's namespace.
        mapping: the mapping, with resolved topics.
        controller: the controller; it is reset.

    Raises:
        MappingError: a type or field is unknown, or not that of the topic.
        MiddlewareError: an operation of the middleware failed.
    """

    def __init__(self, node: Middleware, mapping: Mapping, controller: Controller) -> None:
        self._node, self._mapping, self._controller = node, mapping, controller
        self._inputs = Inputs(node, mapping.sensors)
        self._outputs = Outputs(node, mapping.actuators)
        self._steps = node.publisher("~/steps", "std_msgs/Float32MultiArray", _STEPS_DEPTH)
        node.service("~/reset", "std_srvs/Empty", lambda _, __: self._reset())
        # Topics work between implementations of DDS, services do not. `ros2 topic pub --once` sends as soon
        # as it has discovered a subscription, which only a reliable subscription is certain to receive.
        node.subscribe("~/reset", "std_msgs/Empty", lambda _: self._reset(), _EVENTS_DEPTH, reliable=True)
        self._stopped, self._begun, self._refused = True, False, False
        self._logged_at = self._looked = float("-inf")
        self._reason = ""
        """The last logged reason why the robot stands still; empty while the controller runs."""
        self._clock, self._moved, self._halted = -1.0, time.monotonic(), float("-inf")
        self._halts = False
        self._last = self._next = float("-inf")
        controller.reset()

    def run(self, has_ended: Callable[[], bool]) -> None:
        """Run until `ended` returns true or the node is shut down; then stop the robot.

        Raises:
            MappingError: other nodes use a topic with another type.
            MiddlewareError: a message cannot be published.
        """
        try:
            while not has_ended() and not self._node.has_ended():
                now = self._node.now()
                self._watch(now)
                if self._due(now):
                    self._cycle()
                else:
                    self._node.spin_once(min(max(self._next - now, 0.0), 0.05) if now else 0.05)
        finally:
            if not self._node.has_ended():
                self._outputs.stop()

    def _watch(self, now: float) -> None:
        """Stop the robot while the clock of a simulation stands still, because there are no cycles."""
        real = time.monotonic()
        if now != self._clock:
            if self._halts:
                self._node.say("info", "/clock goes on")
            self._clock, self._moved, self._halts = now, real, False
            return
        if real - self._moved < _STILL_S or (self._halts and real - self._halted < _REPEAT_S):
            return
        if not self._halts:
            problem = "/clock stands still" if now else "nothing comes from /clock, and use_sim_time is set"
            self._node.say("warning", f"stopped: {problem}")
        self._halts, self._halted = True, real
        self._outputs.stop()

    def _due(self, now: float) -> bool:
        """Return whether a cycle is due. Missed cycles are skipped."""
        if not now:
            self._log_rarely("waiting for /clock, since use_sim_time is set")
            return False
        if now < self._last:  # a simulation was reset
            self._next = now
        self._last = now
        if now < self._next:
            return False
        period = 1 / self._mapping.rate
        self._next = self._next + period if now < self._next + period else now + period
        return True

    def _cycle(self) -> None:
        missing = self._inputs.missing()
        if missing is not None:
            self._stop(missing)
            return
        if self._stopped:
            self._node.say("info", f"all sensors are there: the controller runs at {self._mapping.rate:g} Hz")
            if self._mapping.reset_after_silence:
                self._controller.reset()
            self._stopped, self._begun, self._reason = False, True, ""
        self._inputs.draw()
        sensors = list(self._inputs.values)
        try:
            actuators = self._controller.step(sensors)
        except ValueError as error:  # an overflow, or a topic as the source of random numbers
            if not self._refused:
                self._node.say("warning", f"stopped: {error}")
            self._refused = True
            self._outputs.stop()
            return
        self._refused = False
        self._outputs.publish(actuators)
        self._show(sensors, actuators)

    def _stop(self, missing: Missing) -> None:
        """Stop the robot, in every cycle for late subscribers, and log silent sensors."""
        if self._begun:
            self._log_rarely(missing.text("stopped", ": nothing comes from "), "warning")
        else:
            self._log_rarely(missing.text("waiting", " for "))
            self._look()
        self._stopped = True
        self._outputs.stop()

    def _log_rarely(self, text: str, level: str = "info") -> None:
        """Log why the robot stands still: at once, when the reason changes, and from time to time."""
        since = time.monotonic() - self._logged_at
        changed = text != self._reason and since >= _SAY_CHANGE_S
        if not self._reason or changed or since >= _SAY_EVERY_S:
            self._logged_at, self._reason = time.monotonic(), text
            self._node.say(level, text)

    def _look(self) -> None:
        """Check the types of topics again, as other nodes may be discovered late."""
        if time.monotonic() - self._looked >= _LOOK_EVERY_S:
            self._looked = time.monotonic()
            self._inputs.check_types()
            self._outputs.check_types()

    def _show(self, sensors: Sequence[float], actuators: Sequence[float]) -> None:
        """Publish sensors and actuators if there are subscribers."""
        if not self._steps.listeners():
            return
        step = self._steps.new()
        step.data = [*sensors, *actuators]
        dimension = self._node.new("std_msgs/MultiArrayDimension")
        dimension.label, dimension.size = "sensors, actuators", len(step.data)
        dimension.stride = dimension.size
        step.layout.dim.append(dimension)
        self._steps.publish(step)

    def _reset(self) -> None:
        self._controller.reset()
        self._node.say("info", "the controller was reset")


def drive(
    node: Middleware,
    mapping: str,
    controller: Controller,
    sensors: Sequence[str],
    actuators: Sequence[str],
) -> int:
    """Run a controller until SIGINT, SIGTERM or SIGHUP; return the exit status.

    The status is 2 for a mistake in the mapping.

    Args:
        node: a node in the robot's namespace; it is closed at the end.
        mapping: path of the mapping.
        controller: the controller.
        sensors: names of its sensors.
        actuators: names of its actuators.
    """
    signals: list[int] = []
    for number in ending():
        signal.signal(number, lambda received, _: signals.append(received))
    try:
        read = read_mapping(load(mapping), sensors, actuators)
        Control(node, resolve_topics(read, node.resolve), controller).run(lambda: bool(signals))
    except MappingError as error:
        node.say("error", str(error))
        return 2
    except MiddlewareError as error:
        node.say("error", str(error))
        return 1
    finally:
        node.close()
    return 0


def ending() -> list[int]:
    """Return the signals that end a program; SIGHUP only if it is not ignored, as with nohup."""
    numbers: list[int] = [signal.SIGINT, signal.SIGTERM]
    hung_up = getattr(signal, "SIGHUP", None)  # not on Windows
    if hung_up is not None and signal.getsignal(hung_up) != signal.SIG_IGN:
        numbers.append(hung_up)
    return numbers


def load(file: str) -> object:
    """Load a mapping file. Raises MappingError if it cannot be read or is not valid YAML."""
    import yaml  # noqa: PLC0415 - only files need it

    try:
        with open(file, encoding="utf-8") as stream:  # noqa: PTH123 - as short as pathlib, for old Pythons
            value: object = yaml.load(stream, Loader=_loader(yaml))  # noqa: S506 - one for plain values
    except OSError as error:
        raise MappingError("mapping", f"{file}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MappingError("mapping", f"{file}: is not YAML: {_line(error)}") from None
    if _depth(value) > _DEEPEST:
        raise MappingError("mapping", f"{file}: is nested more than {_DEEPEST} levels deep")
    return value


def _depth(value: object, above: int = 0) -> int:
    """Return the depth of nesting, at most one more than allowed, as a value may contain itself."""
    inner = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
    if above > _DEEPEST:
        return above
    return max((_depth(item, above + 1) for item in inner), default=above)


def _loader(yaml: Any) -> Any:
    """Return a loader of plain values that reads `1e-3` as a number, as in YAML 1.2."""
    import re  # noqa: PLC0415 - beside the only use

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Reads plain values."""

    number = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+.0123456789"))
    return Loader


def _line(error: Exception) -> str:
    mark: Any | None = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error) or type(error).__name__
    return f"line {mark.line + 1}: {problem}" if mark is not None else str(problem)
