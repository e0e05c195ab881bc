"""Stands in for CoppeliaSim: `python simulator.py PORT [STEPS]`, a scene behind the published remote API.

Requests and answers are CBOR over a ZeroMQ socket, as the published client sends them. Two robots, /rover[0]
and /rover[1], have two wheels (leftJoint, rightJoint) and a proximity sensor (front), which senses a wall at
x = 2 m from 1 m away.
"""

# mypy: ignore-errors

import math
import sys

import cbor
import zmq

DT, RADIUS, BASE, WALL, RANGE = 0.05, 0.1, 0.4, 2.0, 1.0
STOPPED, RUNNING = 0, 17
ROBOTS = ("/rover[0]", "/rover[1]")
PARTS = ("", "/leftJoint", "/rightJoint", "/front")


class Sim:
    """The functions of `sim` that are called, under their published names."""

    simulation_stopped = STOPPED

    def __init__(self):
        self.paths = [robot + part for robot in ROBOTS for part in PARTS]
        self.home = {index: [0.0, 1.0 - 2 * index, 0.0, 0.0] for index in range(len(ROBOTS))}
        self.poses = {index: list(pose) for index, pose in self.home.items()}
        self.speeds, self.readings, self.stepping = {}, {}, False
        self.state, self.stopping, self.time = STOPPED, 0, 0.0

    def getObject(self, path, options=None):
        if path in self.paths:
            return self.paths.index(path)
        if (options or {}).get("noError"):
            return -1
        raise ValueError(f"sim.getObject: object '{path}' does not exist")

    def setStepping(self, enable):
        self.stepping = enable
        return int(enable)

    def startSimulation(self):
        if self.state != STOPPED:
            raise ValueError("startSimulation: the simulation runs already")
        self.state, self.time, self.readings = RUNNING, 0.0, {}
        self.home = {index: list(pose) for index, pose in self.poses.items()}

    def stopSimulation(self):
        self.stopping = 2 if self.state != STOPPED else 0  # stopped a little later

    def getSimulationState(self):
        if self.stopping:
            self.stopping -= 1
            if not self.stopping:
                self.state, self.speeds = STOPPED, {}
                self.poses = {index: list(pose) for index, pose in self.home.items()}
        return self.state

    def getSimulationTime(self):
        return self.time

    def step(self):
        if self.state != RUNNING or not self.stepping:
            raise ValueError("step: no simulation is stepped")
        for index, pose in self.poses.items():
            left, right = (self.speeds.get(4 * index + part, 0.0) * RADIUS for part in (1, 2))
            pose[3] += DT * (right - left) / BASE
            pose[0] += DT * (left + right) / 2 * math.cos(pose[3])
            pose[1] += DT * (left + right) / 2 * math.sin(pose[3])
            self.readings[4 * index + 3] = max(WALL - pose[0], 0.0)
        self.time += DT

    def setJointTargetVelocity(self, joint, speed):
        self.speeds[joint] = speed

    def getJointVelocity(self, joint):
        return self.speeds.get(joint, 0.0)

    def readProximitySensor(self, sensor):
        if sensor % 4 != 3:
            raise ValueError("readProximitySensor: object is no proximity sensor")
        distance = self.readings.get(sensor, math.inf)
        return (
            (1, distance, [0, 0, distance], -1, [0, 0, -1])
            if distance < RANGE
            else (0, 0.0, [0, 0, 0], -1, [0, 0, 0])
        )

    def getObjectPosition(self, handle):
        x, y, z, _ = self.poses[handle // 4]
        return ([x, y, z],)

    def setObjectPosition(self, handle, place):
        self.poses[handle // 4][:3] = place

    def getObjectOrientation(self, handle):
        return ([0.0, 0.0, self.poses[handle // 4][3]],)

    def setObjectOrientation(self, handle, angles):
        self.poses[handle // 4][3] = angles[2]


def info():
    found = {}
    for name in dir(Sim):
        if not name.startswith("_"):
            value = getattr(Sim, name)
            found[name] = {"func": {}} if callable(value) else {"const": value}
    return found


def main(port, steps):
    """Serve; end in the step of this number."""
    sim, waits = Sim(), None
    socket = zmq.Context().socket(zmq.REP)
    socket.bind(f"tcp://127.0.0.1:{port}")
    while True:
        request = cbor.loads(socket.recv())
        function, arguments = request["func"], request.get("args", [])
        if function == "zmqRemoteApi.require":
            answer = {"ret": []}
        elif function == "zmqRemoteApi.info":
            answer = {"ret": [info()]}
        elif function == "sim.step":  # first it says that it is not ready
            waits, answer = arguments, {"func": "_*wait*_", "args": []}
        else:
            if function == "_*executed*_":
                steps -= 1
                if steps == 0:
                    sys.exit(3)
                function, arguments, waits = "sim.step", waits, None
            try:
                value = getattr(sim, function.removeprefix("sim."))(*arguments)
                answer = {
                    "ret": [] if value is None else list(value) if isinstance(value, tuple) else [value]
                }
            except Exception as error:
                answer = {"err": str(error)}
        socket.send(cbor.dumps(answer))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
