"""S5: refused messages change nothing and do not block the server."""

import json
from collections.abc import Callable, Sequence

from swarmwright.common.json_text import Json, new_hash
from swarmwright.conformance._server_under_test import Server, ServerPeer
from swarmwright.conformance.rules import Skip, WentOn
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import compare_agents
from swarmwright.servers.broker.client import Failure, format_payload

Junk = tuple[str, str | bytes]
"""A topic and a payload."""
Maker = Callable[[str], Sequence[Junk]]
"""Function that makes junk for the hash of an episode."""


def disturb(server: ServerPeer, junk: Maker, why: str, *, free: bool = True) -> None:
    """Publish junk to a free server, and in the first step of an episode, which must continue.

    junk: function of the episode's hash. free: whether a free server gets it, too.

    Raises Failure, which names the faulty message, and Skip if the episode ends correctly but the server also
    continues without answers, so that nothing shows whether it accepted the junk.
    """
    if free:
        _free(server, junk(new_hash()), why)
    try:
        _running(server, junk, why)
    except Failure as failure:
        if isinstance(failure, WentOn) and server.prepare_retry() and not server.waits():
            server.prepare_retry()
            _running(server, junk, why, waits=False)
            raise Skip(
                "the episode went to its end, but the server goes on without an answer (D6.1 leaves that "
                "open), so what it makes of the messages cannot be told"
            ) from None
        raise _find_culprit(server, junk, why) or failure from None


def _free(server: ServerPeer, pieces: Sequence[Junk], why: str) -> None:
    for topic, payload in pieces:
        server.client.publish(topic, payload)
        sent = _describe(topic, payload)
        server.must_answer("an answer to the discovery that followed", f"{sent}, then a discovery")
        server.must_be_silent(why, sent, seconds=0)
    server.must_be_silent(why, f"{_describe_all(pieces)}, each followed by a discovery")


def _running(server: ServerPeer, junk: Maker, why: str, *, waits: bool = True) -> None:
    repeatable = _repeatable(server)
    episode = server.episode()
    episode.configure()
    episode.start()
    episode.gather()
    if episode.over:
        return  # the simulation controls its agents itself
    trajectory = episode.trajectory
    agents = [agent for agent, _, _ in episode.pending]
    pieces = junk(episode.hash)
    sent = f"while it waited for actuators: {_describe_all(pieces)}"
    for topic, payload in pieces:
        server.client.publish(topic, payload)
    if waits:
        episode.must_wait(agents, why, sent)
    try:
        episode.play()
    except Failure as failure:
        raise Failure(failure.came, "the episode goes on with the right actuators", sent) from None
    difference = server.reference.difference(trajectory) if repeatable else ""
    if difference:
        raise Failure(difference, "the episode as if nothing had arrived in between", sent)


def _repeatable(server: ServerPeer) -> bool:
    """Return whether episodes can be compared with the reference; the server is free afterwards."""
    if server.trajectory is None or not server.trajectory.messages:
        return False
    tried = server.deterministic is None and server.repeats is None
    repeatable = server.repeatable
    if tried:
        server.prepare_retry()
    return repeatable


def _find_culprit(server: ServerPeer, junk: Maker, why: str) -> Failure | None:
    """Return the failure of the first message that fails alone; None if there is none."""
    for index in range(len(junk(new_hash()))):
        if not server.prepare_retry():
            return None
        try:
            _running(server, lambda hash_, index=index: junk(hash_)[index : index + 1], why)  # type: ignore[misc]
        except Failure as failure:
            return failure
    return None


def _describe(topic: str, payload: str | bytes) -> str:
    return f"{topic} {format_payload(payload) or '(nothing)'}"


def _describe_all(pieces: Sequence[Junk]) -> str:
    """Describe all messages, shortened if there are many."""
    most = 240 if len(pieces) <= 4 else 90
    texts = [_describe(topic, payload) for topic, payload in pieces]
    return "; ".join(text if len(text) <= most else f"{text[:most]}..." for text in texts)


READING = "protocol.md, Reading"


def _list(*values: object) -> tuple[object, ...]:
    return values


def _actuators(hash_: str, *tries: object, agent: object = 0) -> list[Junk]:
    return [
        ("actuator", json.dumps({"simulation_hash": hash_, "agent": agent, "actuator": value}))
        for value in tries
    ]


@rule(
    "S5.1",
    "Payloads other than a JSON object in UTF-8 are refused, on every topic.",
    where=READING,
    fix="catch errors of your JSON reader; in paho an exception in a callback ends the loop",
    d61="6.1",
    needs=["S2.3"],
)
def no_json(server: ServerPeer) -> None:
    """Send nothing, a word, half an object, a list, a number, and bytes that are not UTF-8."""
    texts: list[str | bytes] = [
        "",
        "hello",
        '{"simulation_hash":',
        "[]",
        "7",
        "null",
        b"\xff\xfe{}",
        b'{"a":"\xc3"}',
        "{}{}",
    ]
    topics = ("discovery", "parameters", "control", "actuator")
    disturb(
        server, lambda _: [(topic, text) for topic in topics for text in texts], "that is not a JSON object"
    )


@rule(
    "S5.2",
    "A message without a required key is refused.",
    where=f"{READING}; protocol/schemas",
    fix="check for each required key before you use a message",
    d61="6.2, Schemas 1, 3, 4 and 6",
    needs=["S2.3"],
)
def missing_keys(server: ServerPeer) -> None:
    """Send each message of a tool without each of its keys."""

    def junk(hash_: str) -> list[Junk]:
        whole = _messages(server, hash_)
        pieces = [
            (topic, json.dumps({name: value for name, value in fields.items() if name != key}))
            for topic, fields in whole
            for key in fields
        ]
        return [*pieces, ("discovery", json.dumps({**server.discovery(), "requirements": {"max_agents": 1}}))]

    disturb(server, junk, "a required key is missing")


def _messages(server: Server, hash_: str) -> list[tuple[str, Json]]:
    actuators = [0.5] * server.actuators
    mine: Json = {"server": server.id, "simulation_hash": hash_}
    # Control omits the optional run, so it starts an episode unless it is refused.
    return [
        ("discovery", server.discovery()),
        ("parameters", mine),
        ("control", mine),
        ("actuator", {"simulation_hash": hash_, "agent": 0, "actuator": actuators}),
    ]


@rule(
    "S5.3",
    "A value of the wrong type is refused: a number in quotes, null, true, a list.",
    where=READING,
    fix="check the type of each key; do not convert text to numbers or booleans",
    d61="6.2, Schemas 1, 3, 4 and 6",
    needs=["S2.3"],
)
def wrong_types(server: ServerPeer) -> None:
    """Send each key with values of other types."""
    hash_free = new_hash()

    def junk(hash_: str) -> list[Junk]:
        mine: Json = {"server": server.id, "simulation_hash": hash_}
        controls: list[Json] = [{"run": value} for value in _list("false", 0, None, [])]
        controls += [{"run": False, "server": value} for value in (str(server.id), None, server.id + 0.5)]
        controls += [{"run": False, "simulation_hash": value} for value in (7, None, [hash_])]
        count = server.actuators
        values = [
            ["0"] * count,
            [None] * count,
            [True] * count,
            [[0.5]] * count,
            "0.5",
            0.5,
            None,
            {"0": 0.5},
        ]
        agents = [
            ("actuator", json.dumps({"simulation_hash": hash_, "agent": agent, "actuator": [0.5] * count}))
            for agent in ("0", None, True, 0.5, [0])
        ]
        needs: list[Json] = [
            {"requirements": value}
            for value in _list(None, [], "2", {"dimensions": "2"}, {"dimensions": None})
        ]
        needs += [{"simulation": 7}, {"simulation_hash": 7}, {"simulation_hash": None}]
        return [
            *(("control", json.dumps({**mine, **changes})) for changes in controls),
            *_actuators(hash_, *values),
            *agents,
            *(("discovery", json.dumps(server.discovery(**changes))) for changes in needs),
            ("parameters", json.dumps({"server": str(server.id), "simulation_hash": hash_free})),
        ]

    disturb(server, junk, "a value has the wrong type")


@rule(
    "S5.4",
    "NaN, infinities and numbers beyond binary32 are refused as actuators.",
    where=READING,
    fix="refuse messages with numbers that are not finite in binary32",
    needs=["S2.3"],
)
def refuses_infinite(server: ServerPeer) -> None:
    """Send NaN, Infinity, 1e999 and 1e39 among actuators."""

    def junk(hash_: str) -> list[Junk]:
        rest = ", 0.5" * (server.actuators - 1)
        words = ("NaN", "Infinity", "-Infinity", "1e999", "-1e39")
        head = f'{{"simulation_hash": "{hash_}", "agent": 0, "actuator": '
        return [("actuator", f"{head}[{word}{rest}]}}") for word in words]

    disturb(server, junk, "the actuators are not finite binary32 numbers", free=False)


@rule(
    "S5.5",
    "The wrong number of actuators is refused.",
    where=READING,
    fix="compare the number of actuators with the simulation's and refuse the whole message",
    needs=["S2.3"],
)
def wrong_number(server: ServerPeer) -> None:
    """Send no actuators, one less, one more, and a thousand more."""
    count = server.actuators
    wrong = [[0.5] * number for number in sorted({0, count - 1, count + 1, count + 1000})]
    disturb(server, lambda hash_: _actuators(hash_, *wrong), f"it takes {count} actuators", free=False)


@rule(
    "S5.6",
    "Actuators of an agent that was not asked are refused.",
    where=READING,
    fix="look up the agent among those asked in this step",
    d61="6.2 Actuator message",
    needs=["S2.3"],
)
def unknown_agent(server: ServerPeer) -> None:
    """Send actuators of agents that cannot exist."""
    values = [0.5] * server.actuators
    agents = (-1, 1_000_000, 2**31, 2**63, 10**30)
    disturb(
        server,
        lambda hash_: [junk for agent in agents for junk in _actuators(hash_, values, agent=agent)],
        "this agent was not asked",
        free=False,
    )


@rule(
    "S5.7",
    "Messages with other hashes are ignored.",
    where="protocol.md, Hash",
    fix="compare simulation_hash of actuator messages with the current episode's",
    d61="6.2 Discovery message, Actuator message",
    needs=["S2.3"],
)
def foreign_hash(server: ServerPeer) -> None:
    """Send actuators with other hashes, some of which share a prefix with the right one."""

    def junk(hash_: str) -> list[Junk]:
        values = [0.5] * server.actuators
        others = (new_hash(), hash_[:-1], f"{hash_}0", hash_.upper() + "A")
        return [piece for other in others for piece in _actuators(other, values)]

    disturb(server, junk, "the hash is another one", free=False)


@rule(
    "S5.8",
    "Messages for other servers are ignored.",
    where="protocol.md, Topics",
    fix="compare server in parameters and control with your ID",
    d61="6.2 Parameters message, Control message",
    needs=["S2.3"],
)
def foreign_server(server: ServerPeer) -> None:
    """Send parameters and control for the next ID: no episode begins or ends."""
    other = server.id + 1
    episode = server.episode()
    sent = episode.configure(server=other)
    sent += f", then {episode.start(server=other)}"
    server.must_be_silent(f"that was for server {other}", sent)
    server.must_answer("an answer: it is free", sent)
    episode.over = True

    def junk(hash_: str) -> list[Junk]:
        fields = {"server": other, "simulation_hash": hash_, "run": False}
        return [("control", json.dumps(fields)), ("parameters", json.dumps({**fields, "maxSteps": 1}))]

    disturb(server, junk, f"it is for server {other}", free=False)


@rule(
    "S5.9",
    "More than 127 levels of nesting are refused, 100 are accepted.",
    where=READING,
    fix="limit the depth in your JSON reader to protect the stack",
    needs=["S2.3"],
)
def refuses_deep(server: ServerPeer) -> None:
    """Send unknown keys, nested 100 and 100,000 levels."""
    note: object = 1
    for _ in range(100):
        note = [note]
    server.must_answer("an answer", "discovery with an unknown key of 100 levels", note=note)
    deep = "[" * 100_000 + "]" * 100_000

    def junk(hash_: str) -> list[Junk]:
        mine = f'"server": {server.id}, "simulation_hash": "{hash_}"'
        stop = f'{{{mine}, "run": false, "note": {deep}}}'
        question = json.dumps(server.discovery())[:-1] + f', "note": {deep}}}'
        return [
            ("control", stop),
            ("discovery", question),
            ("parameters", f'{{{mine}, "note": {deep}}}'),
            ("actuator", deep),
        ]

    disturb(server, junk, "it is nested too deeply")


@rule(
    "S5.10",
    "More than 1 MiB is refused.",
    where="protocol.md, Topics; Reading",
    fix="check the length of a payload before you read it",
    needs=["S2.3"],
)
def refuses_large(server: ServerPeer) -> None:
    """Send messages with an unknown key of 1 MiB."""
    note = "x" * (1 << 20)

    def junk(hash_: str) -> list[Junk]:
        mine = {"server": server.id, "simulation_hash": hash_, "note": note}
        return [
            ("control", json.dumps({**mine, "run": False})),
            ("discovery", json.dumps(server.discovery(note=note))),
            ("actuator", json.dumps({**mine, "agent": 0, "actuator": [0.5] * server.actuators})),
        ]

    disturb(server, junk, "it is larger than 1 MiB")


@rule(
    "S5.11",
    "1.0 is an integer, 1.5 is not.",
    where=READING,
    fix="read integers as JSON numbers without a fraction",
    needs=["S2.3"],
)
def integers(server: ServerPeer) -> None:
    """Play an episode in which servers and agents are written with a decimal point."""
    episode = server.episode()
    client, head = server.client, f'"server": {server.id}.0, "simulation_hash": "{episode.hash}"'
    fields = json.dumps(episode.parameters)[1:-1]
    client.publish("parameters", f"{{{head}{', ' if fields else ''}{fields}}}")
    episode.over = False
    sent = f'control {{{head}, "run": true}}'
    title = json.dumps(server.settings.title)
    client.publish("control", f'{{{head}, "run": true, "simulation": {title}}}')
    episode.receive(sent)
    if episode.over:
        return
    episode.gather()
    for agent, turn, numbers in list(episode.pending):
        values = json.dumps(list(server.policy(agent, turn, numbers)))
        sent = f'{{"simulation_hash": "{episode.hash}", "agent": {agent}.0, "actuator": {values}}}'
        client.publish("actuator", sent)
    episode.pending.clear()
    episode.receive(f"actuator {sent}")


@rule(
    "S5.12",
    "The last of repeated keys counts.",
    where=READING,
    fix="use a JSON library that keeps the last, as most do",
    needs=["S1.2"],
)
def takes_last_key(server: Server) -> None:
    """Send a discovery with the key `simulation` twice, the wrong title first."""
    question = server.discovery()
    text = json.dumps({**question, "first": 1}).replace("{", '{"simulation": "no such simulation", ', 1)
    server.client.publish("discovery", text)
    hash_ = question["simulation_hash"]
    if not server.client.next(lambda message: server.is_answer(message, hash_), server.settings.timeout):
        expected = "an answer: the last of two keys simulation counts"
        raise Failure("nothing came", expected, f"discovery {text}")


@rule(
    "S5.13",
    "max agents in requirements means max_agents; a server without max_agents has no limit.",
    where=f"{READING}; An episode, 1",
    fix="accept both spellings, which D6.1 prints in Schemas 1 and 2",
    needs=["S1.6"],
)
def either_spelling(server: Server) -> None:
    """Require as many agents as announced, and one more; a million if there is no limit."""
    if server.max_agents is not None:
        compare_agents(server, "max agents", server.max_agents)
        return
    for key in ("max_agents", "max agents"):
        needs = {"dimensions": server.settings.dimensions, key: 1_000_000}
        sent = f'discovery with "requirements": {json.dumps(needs)}'
        server.must_answer("an answer: it announces no max_agents", sent, requirements=needs)
