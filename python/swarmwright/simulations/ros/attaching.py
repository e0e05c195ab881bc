"""The program that controls robots, over standard input and output: see `simulations.command.stepwise`."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, Mapping, Sequence
from urllib.parse import urlparse

from .control import ending
from .episodes import Failure, Robots
from .mapping import MappingError
from .middleware import Middleware, MiddlewareError
from .simulation_interfaces import MESSAGES, SERVICES, SimulationError

_PATIENCE_S = 1.0
"""Seconds that processes have to end after SIGINT."""


class ProcessError(Exception):
    """A process cannot be started, or has ended."""


class Simulator:
    """Processes that run while the robots are connected.

    Args:
        command: command that starts the simulator.
        master: whether to start a ROS 1 master on the port of ROS_MASTER_URI.

    Raises ProcessError if a process cannot be started.
    """

    def __init__(self, command: Sequence[str], *, master: bool) -> None:
        self._processes: list[tuple[str, subprocess.Popen[bytes]]] = []
        if master:
            port = str(urlparse(os.environ["ROS_MASTER_URI"]).port)
            self._start(["roscore", "-p", port], "roscore", quiet=True)
        self._start(command, "simulation.start")

    def _start(self, command: Sequence[str], name: str, *, quiet: bool = False) -> None:
        try:
            started = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL if quiet else sys.stderr,
                start_new_session=True,
            )
        except OSError as error:
            self.end()
            raise ProcessError(f"{name}: {command[0]}: {error.strerror}") from error
        self._processes.append((f"{name}: {command[0]}", started))

    def check(self) -> None:
        """Raise ProcessError if a process has ended."""
        for name, process in self._processes:
            status = process.poll()
            if status is not None:
                how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
                raise ProcessError(f"{name} has ended ({how})")

    def end(self) -> None:
        """Ask the processes to end, and kill them after a while."""
        for number, patience in ((signal.SIGINT, _PATIENCE_S), (signal.SIGKILL, _PATIENCE_S)):
            for _, process in reversed(self._processes):
                with suppress(OSError):
                    os.killpg(process.pid, number)
            deadline = time.monotonic() + patience
            for _, process in self._processes:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline - time.monotonic()))


_IDLE_S = 1.0
"""Seconds beyond a step's duration without a message after which continuously moving robots are stopped."""
_CHUNK_BYTES = 1 << 16
"""Largest number of bytes per read."""
_FAILURES = (Failure, MappingError, MiddlewareError, ProcessError, SimulationError, TimeoutError)


def main(arguments: list[str]) -> int:
    """Run episodes until the standard input ends; return the exit status."""
    definition = json.loads(Path(arguments[0]).read_text("utf-8"))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # keeps other output apart from answers
    numbers = ending()
    for number in numbers:
        signal.signal(number, _end)
    program = _Program(definition)
    try:
        for message in program.messages():
            repeated = {"id": message["id"]} if "id" in message else {}
            answer = {**program.answer(message), **repeated}
            answers.write(f"{json.dumps(answer)}\n")
            answers.flush()
    except BrokenPipeError:
        pass
    finally:
        try:
            for number in numbers:
                signal.signal(number, signal.SIG_IGN)
        finally:  # a signal may come before it is ignored
            program.end()
    return 0


def _end(number: int, _: object) -> None:
    raise SystemExit(128 + number)


class _Program:
    def __init__(self, definition: Mapping[str, Any]) -> None:
        self._definition = definition
        self._simulator: Simulator | None = None
        self._node: Middleware | None = None
        self._robots: Robots | None = None
        self._under_way = False

    def messages(self) -> Any:
        """Yield messages of the standard input until it ends."""
        buffer = b""
        while True:
            line, separator, buffer = buffer.partition(b"\n")
            if separator:
                yield json.loads(line)
                continue
            buffer = line
            self._await_input()
            piece = os.read(0, _CHUNK_BYTES)
            if not piece:
                return
            buffer += piece

    def _await_input(self) -> None:
        """Wait for input; stop continuously moving robots after a while."""
        if self._robots is None or not (self._under_way and self._robots.moves_alone):
            return
        wait = _IDLE_S + float(self._definition["step"]["duration"])
        if not select.select([0], [], [], wait)[0]:
            self._robots.stop()
            select.select([0], [], [])
            self._robots.rest()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the answer to a message."""
        try:
            if "reset" in message:
                reset = message["reset"]
                answer = self._connect().reset(reset["parameters"], int(reset["seed"]))
            else:
                answer = self._connect().step(message["actuators"])
        except _FAILURES as error:
            return self._report_failure(str(error))
        except Exception as error:  # noqa: BLE001 - of ROS, or of the simulator's definitions; reported
            traceback.print_exc()
            return self._report_failure(f"{type(error).__name__}: {error}")
        self._under_way = "sensors" in answer
        return answer

    def _report_failure(self, reason: str) -> Mapping[str, Any]:
        self._under_way = False
        with suppress(Exception):
            if self._robots is not None:
                self._robots.stop()
        if self._simulator is not None:
            time.sleep(0.05)  # the simulator may be about to end
            try:
                self._simulator.check()
            except ProcessError as error:
                reason = str(error)
        return {"error": reason}

    def _connect(self) -> Robots:
        """Return the robots, connecting to them on the first call."""
        if self._robots is None:
            definition = self._definition
            if definition["start"] is not None:
                self._simulator = Simulator(definition["start"], master=definition["ros"] == 1)
            self._node = _node(definition)
            self._robots = Robots(definition, self._node, self._check)
            self._node.on_shutdown(self._robots.stop)
        return self._robots

    def _check(self) -> None:
        if self._simulator is not None:
            self._simulator.check()
        if self._node is not None and self._node.has_ended():
            raise MiddlewareError("the node was shut down")

    def end(self) -> None:
        """Stop the robots and leave."""
        with suppress(Exception):
            if self._robots is not None:
                self._robots.stop()
        with suppress(Exception):
            if self._node is not None:
                self._node.close()
        if self._simulator is not None:
            self._simulator.end()


def _node(definition: Mapping[str, Any]) -> Middleware:
    """Create a node. Raises MiddlewareError."""
    kind, simulated = definition["middleware"], definition["step"]["clock"] == "ros"
    name = f"swarmwright_{os.getpid()}"
    try:
        if kind == "rospy":
            from .rospy_middleware import Rospy

            return Rospy(name, use_sim_time=simulated, patience=float(definition["startup"]))
        if kind == "rclpy":
            import rclpy
            from rclpy.node import Node
            from rclpy.parameter import Parameter
            from rclpy.signals import SignalHandlerOptions

            from .rclpy_middleware import Rclpy

            # rclpy's handlers would leave ROS before the robots are stopped.
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            time_of = Parameter("use_sim_time", value=simulated)
            return Rclpy(Node(name, parameter_overrides=[time_of]))
        from .dds import Dds, define

        define(MESSAGES, SERVICES)
        return Dds(name, use_sim_time=simulated)
    except ImportError as error:
        raise MiddlewareError(
            f"{sys.executable} cannot import {error.name or kind} ({error}); source the setup.bash of ROS, "
            "or set simulation.python to the Python that ROS is installed for"
        ) from error
