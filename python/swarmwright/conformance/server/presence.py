"""S7: presence messages and announcements."""

import json
import re
import time

from swarmwright.common.json_text import Json, is_number
from swarmwright.conformance._server_under_test import Episode, Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import PRESENCE, TOPICS, Client, Failure, Message, format_payload

MODES = ("batched", "offloaded")
"""Modes whose servers have presence and can be reserved by named tools."""


def read_retained(server: Server, topics: list[str]) -> list[Message]:
    """Return the retained messages on these topics."""
    with Client(server.client.url, server.prefix, topics) as client:
        return [message for message in client.drain(server.quiet) if message.retained and message.payload]


def must_have_presence(server: Server) -> bool:
    """Return whether the announcement requires presence: it has an instance, or a mode of `MODES`."""
    modes = server.announced.get("modes")
    return bool(server.instance) or (isinstance(modes, list) and any(mode in modes for mode in MODES))


def skip_without_presence(server: Server) -> None:
    """Skip the rule unless extensions are announced, and presence exists or is required by one of them."""
    server.announces()
    if must_have_presence(server) or read_retained(server, [f"{PRESENCE}{server.id}"]):
        return
    raise Skip(
        "no presence is published, and none is required: capabilities.swarmwright has no instance and none "
        f"of the modes {', '.join(MODES)}"
    )


WHERE = "protocol.md, Presence"
STAMP = re.compile(r"\d{4}-\d\d-\d\d[Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)")
DETERMINISM = ("bitwise", "statistical", "none")
_MOST_SIDES = 256
_MOST_NAME = 100
"""Limits of the sides of a match in server.schema.json."""
CHANGE_TOLD_S = 2.0
"""Seconds within which a change of presence is published, if it lasts at least 150 ms."""


def presence(server: Server) -> Json:
    """Return the retained message; skip the rule if there is none and none is required."""
    messages = read_retained(server, [f"{PRESENCE}{server.id}"])
    if not messages:
        skip_without_presence(server)
        raise Failure(f"nothing is retained on {PRESENCE}{server.id}", "a presence message")
    return messages[-1].json


def await_presence(server: Server, state: str) -> Json:
    """Wait until presence has a state, and return it."""
    limit = time.monotonic() + CHANGE_TOLD_S + server.settings.timeout
    current: object = None
    while time.monotonic() < limit:
        message = presence(server)
        current = message.get("state")
        if current == state:
            return message
    raise Failure(f'the state stays "{current}"', f'"{state}"')


@rule(
    "S7.1",
    "capabilities.swarmwright has the types of the schema.",
    where=f"{WHERE}; protocol/schemas/server.schema.json",
    fix="announce what you offer and omit the rest; peers ignore unknown modes",
    needs=["S1.3"],
)
def announcement(server: Server) -> str:
    """Check the types of the announced fields."""
    server.announces()
    extension = server.announced
    for key, least in (("version", 1), ("sensors", 1), ("actuators", 1), ("batch", 1), ("pid", 0)):
        value = extension.get(key, least)
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise Failure(f'"{key}" is {value!r}', f"an integer from {least}")
    for key in ("modes", "controllers", "metrics", "distributions"):
        value = extension.get(key, ["stepwise"])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise Failure(f'"{key}" is {value!r}', "a list of names")
    if not _are_sides(extension.get("sides", [])):
        expected = "a list of sides, each with name, groups and optionally fitness; each group in one side"
        raise Failure(f'"sides" is {extension["sides"]!r}', expected)
    for key in ("scenes", "control"):
        if not isinstance(extension.get(key, False), bool):
            raise Failure(f'"{key}" is {extension[key]!r}', "true or false")
    for key in ("instance", "host"):
        if not isinstance(extension.get(key, "text"), str) or not extension.get(key, "text"):
            raise Failure(f'"{key}" is {extension[key]!r}', "text, or no such key")
    if extension.get("modes") == []:
        raise Failure('"modes" is empty', "one mode at least, or no such key")
    if "determinism" in extension and extension["determinism"] not in DETERMINISM:
        raise Failure(f'"determinism" is {extension["determinism"]!r}', " or ".join(DETERMINISM))
    return ", ".join(extension.get("modes", ["stepwise"]))


def _are_sides(value: object) -> bool:
    """Return whether these are sides of a match, each with another name and other groups."""

    def is_name(name: object) -> bool:
        return isinstance(name, str) and 1 <= len(name) <= _MOST_NAME

    names: list[str] = []
    groups: list[str] = []
    if not isinstance(value, list) or len(value) > _MOST_SIDES:
        return False
    for side in value:
        own = side.get("groups") if isinstance(side, dict) else None
        if not isinstance(own, list) or not 1 <= len(own) <= _MOST_SIDES:
            return False
        if not all(is_name(name) for name in (side.get("name"), side.get("fitness", "fitness"), *own)):
            return False
        names.append(side["name"])
        groups += own
    return len(set(names)) == len(names) and len(set(groups)) == len(groups)


@rule(
    "S7.2",
    "It keeps a complete retained presence message, ready while it is free.",
    where=f"{WHERE}; protocol/schemas/presence.schema.json",
    fix="publish presence retained on connection and on each change of state",
    needs=["S1.3"],
)
def keeps_presence(server: Server) -> None:
    """Check the retained message."""
    message = presence(server)
    message = await_presence(server, "ready")
    text = f"presence {format_payload(json.dumps(message))}"
    capabilities = message.get("capabilities")
    if message.get("version") != 1 or message.get("server") != server.id:
        raise Failure(text, f'"version" is 1 and "server" {server.id}')
    if (
        not isinstance(message.get("simulations"), list)
        or server.settings.title not in message["simulations"]
    ):
        raise Failure(text, f'"simulations" has "{server.settings.title}"')
    if not isinstance(capabilities, dict) or not is_number(capabilities.get("dimensions")):
        raise Failure(text, '"capabilities" is an object with the number "dimensions"')
    if not isinstance(message.get("since"), str) or not STAMP.fullmatch(message["since"]):
        raise Failure(text, '"since" is a time as RFC 3339 has it')
    announced = capabilities.get("swarmwright")
    instance = announced.get("instance") if isinstance(announced, dict) else None
    if instance is not None and message.get("instance", instance) != instance:
        raise Failure(text, f'"instance" is "{instance}", as capabilities.swarmwright announces it')


@rule(
    "S7.3",
    "Presence offers the same as the answer to a discovery.",
    where=WHERE,
    fix="build both messages from the same data",
    needs=["S7.2"],
)
def consistent(server: Server) -> None:
    """Compare simulations and capabilities in both."""
    message, answer = presence(server), server.must_answer("an answer")
    for key in ("simulations", "capabilities"):
        if message[key] != answer.get(key):
            raise Failure(
                f"{key} in presence: {format_payload(json.dumps(message[key]))}",
                format_payload(json.dumps(answer.get(key))),
            )


def _begin_waiting(server: Server) -> Episode:
    """Begin an episode of conformance/a whose agents wait for actuators."""
    presence(server)
    episode = server.episode(tool="conformance/a")
    episode.configure()
    episode.start()
    episode.gather()
    if episode.over:
        raise Skip("the simulation controls its agents itself, it is taken for no time")
    return episode


@rule(
    "S7.4",
    "Presence is busy with the tool's name while the server is reserved, then ready again.",
    where=WHERE,
    fix="publish presence once a state has lasted 150 ms; include a named tool",
    needs=["S7.2", "S2.9"],
)
def busy(server: Server) -> None:
    """Wait during an episode of a named tool, then end it."""
    episode = _begin_waiting(server)
    message = await_presence(server, "busy")
    if message.get("tool") != "conformance/a":
        raise Failure(f'"tool" is {message.get("tool")!r}', "'conformance/a', who has the server")
    episode.stop()
    await_presence(server, "ready")


@rule(
    "S7.5",
    "No message on the seven topics is retained.",
    where="protocol.md, Topics",
    fix="retain nothing but presence",
    needs=["S2.3"],
)
def nothing_else(server: Server) -> None:
    """Check what a new subscriber gets from the seven topics after an episode."""
    server.play()
    if server.own_broker is None:
        raise Skip("other clients use this broker; let the kit start one")
    messages = read_retained(server, list(TOPICS))
    if messages:
        raise Failure(f"the broker keeps {messages[0]}", "nothing retained")


@rule(
    "S7.6",
    "Presence is published again when control is rejected because another tool has the server.",
    where=WHERE,
    fix="republish presence on such a rejection, so that the tool need not wait for its time-out",
    needs=["S7.4"],
)
def repeats_presence(server: Server) -> None:
    """Send control of another tool in the first step of a named tool's episode."""
    episode = _begin_waiting(server)
    await_presence(server, "busy")
    server.client.drain(server.quiet)
    other = server.episode(tool="conformance/b")
    sent = f"{other.configure()}, then {other.start()}"
    other.over = True
    topic = f"{PRESENCE}{server.id}"
    if server.client.next(lambda message: message.topic == topic, server.settings.timeout) is None:
        came = f"nothing came on {topic} within {server.settings.timeout:g} s"
        raise Failure(came, "presence, once more", sent)
    episode.stop()
