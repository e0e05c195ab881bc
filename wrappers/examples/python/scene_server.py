"""The line server with scenes, so that `swarmwright replay` can show its episodes."""

import struct

import msgpack
from line_server import SERVER, Server, client, refuse, serve, text


def numbers(*values):
    return struct.pack(f"<{len(values)}f", *values)


class ShowingServer(Server):
    capabilities = {**Server.capabilities, "swarmwright": {"version": 1, "scenes": True}}
    topic = None

    def on_control(self, fields):
        if self.hash is None:
            self.topic = text(fields["reply"]) if isinstance(fields.get("scenes"), list) else None
            if self.topic is not None and not self.topic.startswith("swarmwright/v1/tool/"):
                refuse(f"{self.topic!r} is not the topic of a tool")
        super().on_control(fields)

    def show(self):
        if self.topic is None:
            return
        x = self.line.x
        scene = {
            "kind": "scene",
            "version": 1,
            "server": SERVER,
            "simulation_hash": self.hash,
            "step": self.line.steps,
            "fitness": self.line.fitness(),
            "width": 40,
            "height": 4,
            "bodies": {
                "looks": [["goal", ""], ["agent", "free"]],
                "look": struct.pack(f"<{1 + len(x)}I", 0, *(1 for _ in x)),
                "x": numbers(20, *(20 + position for position in x)),
                "y": numbers(2, *(2 for _ in x)),
                "radius": numbers(0.5),
            },
        }
        client.publish(self.topic, msgpack.packb(scene))


serve(ShowingServer())
