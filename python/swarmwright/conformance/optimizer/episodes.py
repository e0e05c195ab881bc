"""O1 to O3: how a tool finds servers, conducts episodes, and answers sensor messages."""

import json
import time
from collections import Counter
from collections.abc import Iterator

import numpy as np

from swarmwright.common.json_text import is_number
from swarmwright.conformance.optimizer._stage import (
    AGENTS,
    STEPS,
    Actor,
    Batching,
    Json,
    Offloading,
    Played,
    make_sensors,
)
from swarmwright.conformance.optimizer._tool import Tool, must_go_on, rule
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure

EPISODE = "protocol.md, An episode"


@rule(
    "O1.1",
    "It sends a discovery: simulation and simulation_hash as text, requirements with dimensions.",
    where="protocol.md, Topics; protocol/schemas/discovery.schema.json",
    fix="publish {simulation, simulation_hash, requirements: {dimensions}} on discovery",
    d61="6.2 Discovery message, Schema 1",
    seconds=600,
)
def asks(tool: Tool) -> str:
    """Check the discoveries of a whole run."""
    record = tool.plain()
    discoveries = record.on("discovery")
    if not discoveries:
        raise Failure(f"no discovery came; {record.ended or 'the tool was silent'}", "a discovery")
    for content in discoveries:
        needs = content.get("requirements")
        text = f"discovery {json.dumps(content)}"
        for key in ("simulation", "simulation_hash"):
            if not isinstance(content.get(key), str):
                raise Failure(text, f'"{key}" is text')
        if not isinstance(needs, dict) or not is_number(needs.get("dimensions")):
            raise Failure(text, '"requirements" is an object with the number "dimensions"')
        if "max_agents" in needs and not is_number(needs["max_agents"]):
            raise Failure(text, '"max_agents" is a number, or left out')
    return f'{len(discoveries)} discoveries of "{discoveries[0]["simulation"]}"'


@rule(
    "O1.2",
    "It sends parameters and control only to servers that have answered.",
    where=f"{EPISODE}, 1",
    fix="take servers from the answers to your discovery, by hash, not from presence",
    d61="6.2 Server message",
    needs=["O1.1"],
    seconds=600,
)
def uses_answering_servers(tool: Tool) -> None:
    """Require no messages to a server with another ID, and messages to one that answered."""
    record = tool.stepwise()
    servers = {1, 2}
    for topic in ("parameters", "control"):
        for content in record.on(topic):
            if content.get("server") not in servers:
                raise Failure(f"{topic} {json.dumps(content)}", f"messages for the servers {sorted(servers)}")
    if not record.on("parameters"):
        expected = "parameters for a server that answered"
        if tool.process is None:
            expected += "; let the kit start the tool (--exec) if it only offloads or steps batches"
        raise Failure(f"no parameters came; {record.ended or 'the tool was silent'}", expected)


class Late(Actor):
    """Is reserved at first: answers no discovery for two seconds."""

    since = 0.0

    def answers(self, content: Json) -> bool:
        """Return whether two seconds have passed."""
        self.since = self.since or time.monotonic()
        return time.monotonic() > self.since + 2 and super().answers(content)


class LateOffloading(Late, Offloading):
    """The same for tools that only use offloaded evaluation."""


class LateBatching(Late, Batching):
    """The same for tools that only evaluate in batches."""


@rule(
    "O1.3",
    "It repeats the discovery until a server is free.",
    where=f"{EPISODE}, 1",
    fix="repeat the discovery for at least some seconds while no server answers",
    needs=["O1.2"],
    seconds=600,
)
def asks_again(tool: Tool) -> str:
    """Play with one server that is reserved for two seconds."""
    mode = "stepwise" if tool.plain().on("parameters") else tool.find_other_mode()
    late = {"offloaded": LateOffloading, "batched": LateBatching}.get(mode, Late)
    record = tool.scene("late", [late(1)], mode="stepwise" if late is Late else "auto")
    if not (record.finished or record.requests):
        came = f"no episode and no request came; {record.ended}"
        raise Failure(came, "an episode once the server is free", "silence for 2 s")
    return f"{len(record.on('discovery'))} discoveries"


@rule(
    "O2.1",
    "Parameters with the same server and hash precede each control that starts an episode.",
    where=f"{EPISODE}, 2 and 3",
    fix="publish parameters, then control, every time, on one connection",
    d61="6.2 Parameters message, Control message",
    needs=["O1.2"],
    seconds=600,
)
def parameters_first(tool: Tool) -> str:
    """Check each control message that starts an episode."""
    record = tool.stepwise()
    configured: set[tuple[object, object]] = set()
    for topic, content in record.messages:
        key = (content.get("server"), content.get("simulation_hash"))
        if topic == "parameters":
            configured.add(key)
        elif topic == "control" and content.get("run", True) is not False:
            if key not in configured:
                expected = "parameters for this server and hash before it, every time"
                raise Failure(f"control {json.dumps(content)}", expected)
            configured.remove(key)
    if not record.finished:
        raise Failure(f"no episode came to its end; {record.ended}", "an episode", "all that a server sends")
    return f"{len(record.finished)} episodes in {record.seconds:.2f} s"


@rule(
    "O2.2",
    "Parameters, control and actuator messages have their keys, with the right types.",
    where="protocol.md, Topics; protocol/schemas",
    fix="send every required key with the type in the schema",
    d61="6.2, Schemas 3, 4 and 6",
    needs=["O2.1"],
    seconds=600,
)
def types(tool: Tool) -> None:
    """Check every message of a run."""
    record = tool.stepwise()
    if record.wrong:
        raise record.wrong[0]
    for topic, content in record.messages:
        text = f"{topic} {json.dumps(content)}"
        if not isinstance(content.get("simulation_hash"), str):
            raise Failure(text, '"simulation_hash" is text')
        if topic in {"parameters", "control"} and not _whole(content.get("server")):
            raise Failure(text, '"server" is an integer')
        for key in ("run", "visual"):
            if topic == "control" and not isinstance(content.get(key, True), bool):
                raise Failure(text, f'"{key}" is true or false')
        if topic == "actuator" and not _whole(content.get("agent")):
            raise Failure(text, '"agent" is an integer')
        values = content.get("actuator")
        if topic == "actuator" and not (isinstance(values, list) and values and all(map(is_number, values))):
            raise Failure(text, '"actuator" is a list of numbers, at least one')


def _whole(value: object) -> bool:
    return is_number(value) and value >= 0 and value == int(value)


@rule(
    "O2.3",
    "Simultaneous episodes have different hashes.",
    where="protocol.md, Hash",
    fix="add a number to the hashed data, so that every current episode has another hash",
    d61="6.2 Discovery message",
    needs=["O2.1"],
    seconds=600,
)
def hashes(tool: Tool) -> str:
    """Play two servers at once."""
    record = tool.stepwise()
    if "same hash" in record.notes:
        raise Failure(f"the hash {record.notes['same hash']}", "a different hash for each episode")
    if record.together < 2:
        raise Skip("the tool used one server at a time")
    return f"{record.together} episodes at a time"


@rule(
    "O2.4",
    "None of its messages is retained.",
    where="protocol.md, Topics",
    fix="publish without the retain flag",
    needs=["O1.1"],
    seconds=600,
)
def retains_nothing(tool: Tool) -> None:
    """Check the retained messages after a run."""
    tool.plain()
    messages = tool.list_retained()
    if messages:
        raise Failure(f"the broker keeps {messages[0]}", "nothing retained")


@rule(
    "O2.5",
    "Servers are reused, but not during their episode.",
    where="protocol.md, Reservation of servers",
    fix="wait for the fitness before the next control for a server",
    needs=["O2.1"],
    seconds=600,
)
def waits_for_servers(tool: Tool) -> str:
    """Require that control with a new hash follows the fitness of the previous one."""
    record = tool.stepwise()
    stopped = [episode for episode in record.episodes if episode.ended == "stopped"]
    if stopped:
        raise Failure(
            f"{len(stopped)} episodes were ended by the tool", "all of them played to their fitness"
        )
    used = Counter(episode.server for episode in record.finished)
    return ", ".join(f"{count} at server {server}" for server, count in sorted(used.items()))


def answers(tool: Tool) -> Iterator[tuple[Played, int, int, list[object]]]:
    """Yield every answer of finished episodes: episode, agent, turn, actuators."""
    for episode in tool.stepwise().finished:
        for (agent, turn), values in episode.answers.items():
            yield episode, agent, turn, values


@rule(
    "O3.1",
    "It answers each sensor message with one actuator message for its agent and hash.",
    where="protocol.md, An episode, 4",
    fix="publish actuators once per sensor message, with its agent and hash",
    d61="6.2 Sensor message, Actuator message",
    needs=["O2.1"],
    seconds=600,
)
def answers_each(tool: Tool) -> str:
    """Require exactly one answer per sensor message."""
    record = tool.stepwise()
    if record.unasked:
        raise Failure(f"{record.unasked[0]} arrived", "one answer for each agent that was asked")
    count = sum(len(episode.answers) for episode in record.finished)
    return f"{count} answers"


@rule(
    "O3.2",
    "It sends as many actuators as the server announces.",
    where="protocol.md, Presence",
    fix="take the number of outputs from capabilities.swarmwright.actuators",
    needs=["O2.1"],
    seconds=600,
)
def as_many(tool: Tool) -> None:
    """Check the length of every answer."""
    expected = tool.settings.actuators
    for _, agent, _, values in answers(tool):
        if len(values) != expected:
            raise Failure(
                f"{len(values)} actuators {json.dumps(values)} for agent {agent}", f"{expected} actuators"
            )


@rule(
    "O3.3",
    "Actuators are numbers from -1 to +1.",
    where="protocol.md, Topics",
    fix="limit the controller's outputs to -1..+1",
    d61="5.1",
    needs=["O2.1"],
    seconds=600,
)
def stays_in_range(tool: Tool) -> None:
    """Check the range of every number in every answer."""
    for _, agent, _, values in answers(tool):
        for value in values:
            if not is_number(value) or abs(value) > 1:
                raise Failure(f"actuators {json.dumps(values)} for agent {agent}", "numbers from -1 to +1")


@rule(
    "O3.4",
    "Every agent has a separate state: agents with equal sensor histories act the same.",
    where="protocol.md, Controllers; decision 002",
    fix="keep one controller with its state per agent and episode",
    needs=["O3.1"],
    seconds=600,
)
def keeps_states_apart(tool: Tool) -> None:
    """Compare two agents with the same sensors in every turn."""
    for episode in tool.stepwise().finished:
        for turn in range(STEPS):
            answers = [episode.answers.get((agent, turn)) for agent in range(AGENTS)]
            texts = [json.dumps(values) for values in answers if values is not None]
            if len(set(texts)) > 1:
                came = f"in turn {turn} the agents do {' and '.join(texts)}"
                raise Failure(came, "the same: they have sensed the same since the episode began")


@rule(
    "O3.5",
    "Controllers are reset: a candidate acts the same in each of its episodes.",
    where="protocol.md, Controllers; decision 002",
    fix="create or reset all controllers at the start of an episode",
    needs=["O2.3", "O3.4"],
    seconds=600,
)
def reset(tool: Tool) -> str:
    """Compare the episodes of each candidate, which all have the same sensors."""
    episodes = tool.settings.episodes
    if episodes is None or episodes < 2:
        raise Skip("give --episodes K, in how many episodes the tool evaluates each candidate, 2 at least")
    trajectories = Counter(episode.trajectory() for episode in tool.stepwise().finished)
    odd = [trajectory for trajectory, count in trajectories.items() if count % episodes]
    if odd:
        total = sum(trajectories.values())
        came = (
            f"{total} episodes with {len(trajectories)} different trajectories; {odd[0]} arrived "
            f"{trajectories[odd[0]]} times"
        )
        raise Failure(came, f"each trajectory {episodes} times, or a multiple of it")
    return f"{len(trajectories)} different trajectories in {sum(trajectories.values())} episodes"


@rule(
    "O3.6",
    "It works if agents are asked one at a time, and if agents drop out.",
    where="protocol.md, An episode, 4",
    fix="answer each sensor message as it arrives; do not wait for all agents",
    needs=["O3.1"],
    seconds=600,
)
def drop_outs(tool: Tool) -> None:
    """Play two servers whose agents drop out one by one; one asks all agents at once, the other in turn."""
    actors = [Actor(1, drops=True), Actor(2, in_turn=True, drops=True)]
    must_go_on(tool, "drop-outs", actors, "no more sensor messages of agent 1 in the last step")


class Spelled(Actor):
    """Sends equal binary32 sensors in two spellings: with few digits to one agent, with all to the other."""

    def sense(self, agent: int) -> None:
        """Publish a sensor message with numbers that have no short binary form."""
        assert self.episode is not None
        exact = np.array(make_sensors(self.turns[agent], self.stage.sensors), np.float32) * np.float32(0.1)
        values = [float(value) if agent else float(str(value)) for value in exact]
        about = {"simulation": self.title, "simulation_hash": self.episode.hash}
        self.says("sensor", **about, agent=agent, sensor=values)


@rule(
    "O3.7",
    "Sensors are read as the nearest IEEE binary32: 0.1 and 0.10000000149011612 have the same effect.",
    where="protocol.md, Reading; decision 002",
    fix="round sensors to binary32 before the controller: Math.fround in JavaScript, numpy.float32 in Python",
    needs=["O3.4"],
    seconds=600,
)
def binary32(tool: Tool) -> None:
    """Play servers that send the same sensors to two agents in two spellings."""
    record = must_go_on(tool, "spelled", [Spelled(1), Spelled(2)], "sensors in all digits of a binary32")
    for episode in record.finished:
        for turn in range(STEPS):
            first, second = (episode.answers.get((agent, turn)) for agent in range(AGENTS))
            if first is not None and second is not None and first != second:
                came = f"in turn {turn} the agents do {json.dumps(first)} and {json.dumps(second)}"
                raise Failure(came, "the same: they have sensed the same binary32 in two spellings")
