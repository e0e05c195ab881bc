"""Stands in for Webots' own module: those of its published classes and methods that are used."""

# mypy: ignore-errors

import json
import math
import os
import re
import socket
import time
from urllib.parse import unquote


class Device:
    def __init__(self, robot, name):
        self._robot, self._name, self._period = robot, name, 0


class Motor(Device):
    def __init__(self, robot, name):
        super().__init__(robot, name)
        self.speed, self.position = 10.0, 0.0

    def setPosition(self, position):
        self.position = position

    def setVelocity(self, speed):
        if abs(speed) > 10:
            raise ValueError("setVelocity: more than maxVelocity")
        self.speed = speed


class DistanceSensor(Device):
    def enable(self, period):
        self._period = period

    def getValue(self):
        return self._robot.readings.get(self._name, math.nan) if self._period else math.nan


class GPS(Device):
    def enable(self, period):
        self._period = period

    def getValues(self):
        return self._robot.readings.get(self._name, [math.nan] * 3) if self._period else [math.nan] * 3


class Robot:
    def __init__(self):
        scheme, port, name = re.fullmatch(r"(ipc)://(\d+)/(.+)", os.environ["WEBOTS_CONTROLLER_URL"]).groups()
        assert scheme == "ipc"
        for _ in range(200):
            try:
                self._socket = socket.create_connection(("127.0.0.1", int(port)))
                break
            except ConnectionRefusedError:
                time.sleep(0.05)
        self._file = self._socket.makefile("r")
        self.readings, self._reset = {}, False
        self._ask({"name": unquote(name)})
        devices = {"left wheel motor": Motor, "right wheel motor": Motor, "ds": DistanceSensor, "gps": GPS}
        self._devices = {key: kind(self, key) for key, kind in devices.items()}

    def _ask(self, message):
        self._socket.sendall(f"{json.dumps(message)}\n".encode())
        return json.loads(self._file.readline())

    def getBasicTimeStep(self):
        return 50.0

    def getDevice(self, name):
        if name not in self._devices:
            print(f"Device {name} was not found")
        return self._devices.get(name)

    def step(self, milliseconds):
        assert isinstance(milliseconds, int)
        assert milliseconds % 50 == 0
        wheels = [self._devices[f"{side} wheel motor"] for side in ("left", "right")]
        speeds = [wheel.speed if wheel.position == math.inf else 0.0 for wheel in wheels]
        answer = self._ask({"step": milliseconds, "speeds": speeds, "reset": self._reset})
        self._reset = False
        self.readings = answer["readings"]
        return 0


class Supervisor(Robot):
    def simulationReset(self):
        self._reset = True

    def getRoot(self):
        return Root(self)


class Root:
    def __init__(self, robot):
        self._robot = robot

    def getField(self, name):
        assert name == "children"
        return Children(self._robot)


class Children:
    def __init__(self, robot):
        self._nodes = [Node(robot, name) for name in (None, "rover", "rover(1)", "supervisor")]

    def getCount(self):
        return len(self._nodes)

    def getMFNode(self, index):
        return self._nodes[index]


class Node:
    """A robot, or something that has no name."""

    def __init__(self, robot, name):
        self._robot, self._name = robot, name

    def getField(self, name):
        return None if self._name is None and name == "name" else Field(self._robot, self._name, name)

    def getPosition(self):
        return self._pose()[:3]

    def getOrientation(self):
        c, s = math.cos(self._pose()[3]), math.sin(self._pose()[3])
        return [c, -s, 0, s, c, 0, 0, 0, 1]

    def resetPhysics(self):
        pass

    def _pose(self):
        return self._robot._ask({"get": True})["poses"][self._name]


class Field:
    def __init__(self, robot, node, name):
        self._robot, self._node, self._name = robot, node, name

    def getSFString(self):
        assert self._name == "name"
        return self._node

    def getSFVec3f(self):
        assert self._name == "translation"
        return self._robot._ask({"get": True})["poses"][self._node][:3]

    def setSFVec3f(self, values):
        assert self._name == "translation"
        self._robot._ask({"set": [self._node, 0, list(values)]})

    def setSFRotation(self, values):
        assert self._name == "rotation"
        assert values[:3] == [0.0, 0.0, 1.0]
        self._robot._ask({"set": [self._node, 3, [values[3]]]})
