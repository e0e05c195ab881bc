"""O2: from parameters to fitness."""

import json
from collections import Counter

from swarmwright.common.json_text import is_number
from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._tool import Tool
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure

EPISODE = "protocol.md, An episode"


@rule(
    "O2.1",
    "Parameters come before each control that starts an episode, with the same server and hash.",
    where=f"{EPISODE}, 2 and 3",
    fix="publish parameters, then control, every time, on one connection, with the same simulation_hash",
    d61="6.2 Parameters message, Control message",
    needs=["O1.2"],
    seconds=600,
)
def parameters_first(tool: Tool) -> str:
    """Each control that starts an episode."""
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
    fix="send every key that is required, with the type that the schema says",
    d61="6.2, Schemas 3, 4 and 6",
    needs=["O2.1"],
    seconds=600,
)
def types(tool: Tool) -> None:
    """Every message of a run."""
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
    "Episodes that run at the same time have different hashes.",
    where="protocol.md, Hash",
    fix="give every episode under way a different hash: put a number into what is hashed",
    d61="6.2 Discovery message",
    needs=["O2.1"],
    seconds=600,
)
def hashes(tool: Tool) -> str:
    """Two servers at once."""
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
def not_retained(tool: Tool) -> None:
    """What the broker keeps after a run."""
    tool.plain()
    kept = tool.retained()
    if kept:
        raise Failure(f"the broker keeps {kept[0]}", "nothing retained")


@rule(
    "O2.5",
    "Servers are used again, and none while its episode runs.",
    where="protocol.md, Who is taken, and when",
    fix="wait for the fitness before the next control for this server",
    needs=["O2.1"],
    seconds=600,
)
def one_at_a_time(tool: Tool) -> str:
    """No control with a new hash before the fitness of the one before."""
    record = tool.stepwise()
    stopped = [episode for episode in record.episodes if episode.ended == "stopped"]
    if stopped:
        raise Failure(
            f"{len(stopped)} episodes were ended by the tool", "all of them played to their fitness"
        )
    used = Counter(episode.server for episode in record.finished)
    return ", ".join(f"{count} at server {server}" for server, count in sorted(used.items()))
