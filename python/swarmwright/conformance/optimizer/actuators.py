"""O3: what a tool answers to sensors."""

import json
from collections import Counter
from collections.abc import Iterator

import numpy as np

from swarmwright.common.json_text import is_number
from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import AGENTS, STEPS, Actor, Played, sensed
from swarmwright.conformance.optimizer._tool import Tool, must_go_on
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure


def answers(tool: Tool) -> Iterator[tuple[Played, int, int, list[object]]]:
    """Every answer of finished episodes: episode, agent, turn, actuators."""
    for episode in tool.stepwise().finished:
        for (agent, turn), values in episode.answers.items():
            yield episode, agent, turn, values


@rule(
    "O3.1",
    "It answers each sensor message with one actuator message, for its agent and hash.",
    where="protocol.md, An episode, 4",
    fix="publish actuators when sensors come, once, with the agent and hash of the sensor message",
    d61="6.2 Sensor message, Actuator message",
    needs=["O2.1"],
    seconds=600,
)
def one_each(tool: Tool) -> str:
    """Nothing is missing, nothing comes twice."""
    record = tool.stepwise()
    if record.unasked:
        raise Failure(f"{record.unasked[0]} came", "one answer for each agent that was asked")
    count = sum(len(episode.answers) for episode in record.finished)
    return f"{count} answers"


@rule(
    "O3.2",
    "It sends as many actuators as the server announces.",
    where="protocol.md, Presence",
    fix="make the controller's outputs as many as capabilities.swarmwright.actuators says",
    needs=["O2.1"],
    seconds=600,
)
def as_many(tool: Tool) -> None:
    """The length of every answer."""
    wanted = tool.settings.actuators
    for _, agent, _, values in answers(tool):
        if len(values) != wanted:
            raise Failure(
                f"{len(values)} actuators {json.dumps(values)} for agent {agent}", f"{wanted} actuators"
            )


@rule(
    "O3.3",
    "Actuators are numbers from -1 to +1.",
    where="protocol.md, Topics",
    fix="limit what the controller puts out to -1..+1 before it is sent",
    d61="5.1",
    needs=["O2.1"],
    seconds=600,
)
def in_range(tool: Tool) -> None:
    """Every number of every answer."""
    for _, agent, _, values in answers(tool):
        for value in values:
            if not is_number(value) or abs(value) > 1:
                raise Failure(f"actuators {json.dumps(values)} for agent {agent}", "numbers from -1 to +1")


@rule(
    "O3.4",
    "Every agent has a separate state: agents that have sensed the same act the same.",
    where="protocol.md, Controllers; decision 002",
    fix="keep a controller with its state for each agent of an episode",
    needs=["O3.1"],
    seconds=600,
)
def own_states(tool: Tool) -> None:
    """Two agents that sense the same in every turn."""
    for episode in tool.stepwise().finished:
        for turn in range(STEPS):
            found = [episode.answers.get((agent, turn)) for agent in range(AGENTS)]
            told = [json.dumps(values) for values in found if values is not None]
            if len(set(told)) > 1:
                came = f"in turn {turn} the agents do {' and '.join(told)}"
                raise Failure(came, "the same: they have sensed the same since the episode began")


@rule(
    "O3.5",
    "Controllers are reset when an episode starts: the same candidate does the same in each of its episodes.",
    where="protocol.md, Controllers; decision 002",
    fix="make or reset the controllers of all agents when an episode starts",
    needs=["O2.3", "O3.4"],
    seconds=600,
)
def reset(tool: Tool) -> str:
    """Every candidate senses the same in all of its episodes, so its trajectories must be the same."""
    episodes = tool.settings.episodes
    if episodes is None or episodes < 2:
        raise Skip("give --episodes K, in how many episodes the tool evaluates each candidate, 2 at least")
    trajectories = Counter(episode.trajectory() for episode in tool.stepwise().finished)
    odd = [trajectory for trajectory, count in trajectories.items() if count % episodes]
    if odd:
        total = sum(trajectories.values())
        came = (
            f"{total} episodes with {len(trajectories)} different trajectories; {odd[0]} came "
            f"{trajectories[odd[0]]} times"
        )
        raise Failure(came, f"each trajectory {episodes} times, or a multiple of it")
    return f"{len(trajectories)} different trajectories in {sum(trajectories.values())} episodes"


@rule(
    "O3.6",
    "It goes on when agents are asked one at a time, and when agents drop out.",
    where="protocol.md, An episode, 4",
    fix="answer the sensor messages that come; do not wait for those of all agents",
    needs=["O3.1"],
    seconds=600,
)
def drop_outs(tool: Tool) -> None:
    """Two servers whose agents are out one after the other, asked at once and in turn."""
    actors = [Actor(1, drops=True), Actor(2, in_turn=True, drops=True)]
    must_go_on(tool, "drop-outs", actors, "no more sensor messages of agent 1 in the last step")


class Spelled(Actor):
    """Says the same binary32 to its agents in two ways: to the first in few digits, to the other in all."""

    def sense(self, agent: int) -> None:
        """Publish a sensor message with numbers of which none is short in binary."""
        assert self.episode is not None
        exact = np.array(sensed(self.turns[agent], self.stage.sensors), np.float32) * np.float32(0.1)
        values = [float(value) if agent else float(str(value)) for value in exact]
        about = {"simulation": self.title, "simulation_hash": self.episode.hash}
        self.says("sensor", **about, agent=agent, sensor=values)


@rule(
    "O3.7",
    "Sensors are read as the nearest IEEE binary32: agents that have sensed 0.1 and 0.10000000149011612, "
    "which is the same, act the same.",
    where="protocol.md, Reading; decision 002",
    fix="round each number of a sensor message to binary32 before the controller gets it: Math.fround in "
    "JavaScript, numpy.float32 in Python",
    needs=["O3.4"],
    seconds=600,
)
def binary32(tool: Tool) -> None:
    """Servers that say what two agents sense in two ways."""
    record = must_go_on(tool, "spelled", [Spelled(1), Spelled(2)], "sensors in all digits of a binary32")
    for episode in record.finished:
        for turn in range(STEPS):
            one, other = (episode.answers.get((agent, turn)) for agent in range(AGENTS))
            if one is not None and other is not None and one != other:
                came = f"in turn {turn} the agents do {json.dumps(one)} and {json.dumps(other)}"
                raise Failure(came, "the same: they have sensed the same binary32 in two spellings")
