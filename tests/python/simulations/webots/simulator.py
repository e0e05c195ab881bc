"""Stands in for Webots: `simulator.py --port=PORT [STEPS]`, a world whose robots have extern controllers.

The module `controller` beside it talks to it; how, is a matter of these two. As in Webots the simulation goes
on when the controllers of all robots have called `step`, and a reset takes place in a step.

Two robots, rover and rover(1), have two wheels, a distance sensor that sees a wall at x = 2 m from 1 m away,
and a GPS; a third, supervisor, has none.
"""

# mypy: ignore-errors

import json
import math
import selectors
import socket
import sys

RADIUS, BASE, WALL, RANGE = 0.1, 0.4, 2.0, 1.0
ROVERS = ("rover", "rover(1)")
HOME = {"rover": [0.0, 1.0, 0.05, 0.0], "rover(1)": [0.0, -1.0, 0.05, 0.0]}


class World:
    def __init__(self):
        self.poses = {name: list(pose) for name, pose in HOME.items()}
        self.requests = {}

    def answer(self, name, request, connection):
        """Answer a request at once, or when all have stepped."""
        if "set" in request:
            robot, start, values = request["set"]
            self.poses[robot][start : start + len(values)] = values
        elif "step" in request:
            self.requests[name] = (connection, request)
            if len(self.requests) == len(ROVERS) + 1:
                self.advance()
            return
        send(connection, {"poses": self.poses})

    def advance(self):
        waiting, self.requests = self.requests, {}
        seconds = waiting["rover"][1]["step"] / 1000
        if waiting["supervisor"][1].get("reset"):
            self.poses = {name: list(pose) for name, pose in HOME.items()}
        for name in ROVERS:
            left, right = (RADIUS * speed for speed in waiting[name][1]["speeds"])
            pose = self.poses[name]
            pose[3] += seconds * (right - left) / BASE
            pose[0] += seconds * (left + right) / 2 * math.cos(pose[3])
            pose[1] += seconds * (left + right) / 2 * math.sin(pose[3])
        for name, (connection, _) in waiting.items():
            pose = self.poses.get(name, [0, 0, 0, 0])
            ahead = min(max(WALL - pose[0], 0.0), RANGE)
            send(connection, {"readings": {"ds": ahead, "gps": pose[:3]}})


def send(connection, message):
    connection.sendall(f"{json.dumps(message)}\n".encode())


def main(port, steps):
    """Serve; end in the step of this number."""
    world, names, rests = World(), {}, {}
    server = socket.create_server(("127.0.0.1", port))
    selector = selectors.DefaultSelector()
    selector.register(server, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.fileobj is server:
                connection, _ = server.accept()
                selector.register(connection, selectors.EVENT_READ)
                rests[connection] = b""
                continue
            connection = key.fileobj
            piece = connection.recv(65536)
            if not piece:  # a controller has ended, and the world with it
                return
            *lines, rests[connection] = (rests[connection] + piece).split(b"\n")
            for line in lines:
                request = json.loads(line)
                if "name" in request:
                    names[connection] = request["name"]
                    known = request["name"] in (*ROVERS, "supervisor")
                    if known:  # Webots lets others wait
                        send(connection, {})
                else:
                    if "step" in request and names[connection] == "supervisor":
                        steps -= 1
                        if steps == 0:
                            sys.exit(3)
                    world.answer(names[connection], request, connection)


if __name__ == "__main__":
    main(int(sys.argv[1].removeprefix("--port=")), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
