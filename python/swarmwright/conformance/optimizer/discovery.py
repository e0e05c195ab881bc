"""O1: how a tool finds servers."""

import json
import time

from swarmwright.common.json_text import is_number
from swarmwright.conformance.optimizer._requests import Batching, Offloading
from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import Actor, Json
from swarmwright.conformance.optimizer._tool import Tool
from swarmwright.servers.broker.client import Failure

EPISODE = "protocol.md, An episode"


@rule(
    "O1.1",
    "It asks with a discovery: simulation and simulation_hash as text, requirements with dimensions.",
    where="protocol.md, Topics; protocol/schemas/discovery.schema.json",
    fix="publish {simulation, simulation_hash, requirements: {dimensions}} on discovery",
    d61="6.2 Discovery message, Schema 1",
    seconds=600,
)
def asks(tool: Tool) -> str:
    """The discoveries of a whole run."""
    record = tool.plain()
    asked = record.on("discovery")
    if not asked:
        raise Failure(f"no discovery came; {record.ended or 'the tool was silent'}", "a discovery")
    for content in asked:
        needs = content.get("requirements")
        text = f"discovery {json.dumps(content)}"
        for key in ("simulation", "simulation_hash"):
            if not isinstance(content.get(key), str):
                raise Failure(text, f'"{key}" is text')
        if not isinstance(needs, dict) or not is_number(needs.get("dimensions")):
            raise Failure(text, '"requirements" is an object with the number "dimensions"')
        if "max_agents" in needs and not is_number(needs["max_agents"]):
            raise Failure(text, '"max_agents" is a number, or left out')
    return f'{len(asked)} discoveries of "{asked[0]["simulation"]}"'


@rule(
    "O1.2",
    "It sends parameters and control only to servers that have answered.",
    where=f"{EPISODE}, 1",
    fix="take the servers from the answers to your discovery, by their hash; presence is for people",
    d61="6.2 Server message",
    needs=["O1.1"],
    seconds=600,
)
def only_those_who_answered(tool: Tool) -> None:
    """Nothing for a server with another ID, and something for one that answered."""
    record = tool.stepwise()
    known = {1, 2}
    for topic in ("parameters", "control"):
        for content in record.on(topic):
            if content.get("server") not in known:
                raise Failure(f"{topic} {json.dumps(content)}", f"messages for the servers {sorted(known)}")
    if not record.on("parameters"):
        expected = "parameters for a server that answered"
        if tool.process is None:
            expected += "; let the kit start the tool (--exec) if it only offloads or steps batches"
        raise Failure(f"no parameters came; {record.ended or 'the tool was silent'}", expected)


class Late(Actor):
    """Taken in the beginning: answers no discovery for two seconds."""

    since = 0.0

    def answers(self, content: Json) -> bool:
        """After a while only."""
        self.since = self.since or time.monotonic()
        return time.monotonic() > self.since + 2 and super().answers(content)


class LateOffloading(Late, Offloading):
    """The same, for tools that offload all they evaluate."""


class LateBatching(Late, Batching):
    """The same, for tools that evaluate in batches only."""


@rule(
    "O1.3",
    "It asks again until a server is free.",
    where=f"{EPISODE}, 1",
    fix="repeat the discovery while no server answers, for some seconds at least",
    needs=["O1.2"],
    seconds=600,
)
def asks_again(tool: Tool) -> str:
    """One server, which is taken for two seconds."""
    mode = "stepwise" if tool.plain().on("parameters") else tool.other_mode()
    late = {"offloaded": LateOffloading, "batched": LateBatching}.get(mode, Late)
    record = tool.scene("late", [late(1)], mode="stepwise" if late is Late else "auto")
    if not (record.finished or record.requests):
        came = f"no episode and no request came; {record.ended}"
        raise Failure(came, "an episode once the server is free", "silence for 2 s")
    return f"{len(record.on('discovery'))} discoveries"
