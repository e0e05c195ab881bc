"""S1: who answers a discovery, and how."""

import json

from swarmwright.conformance._client import shown
from swarmwright.conformance._rules import Failure, Skip
from swarmwright.conformance._subject import Server, is_number, new_hash
from swarmwright.conformance.server._rules import rule

EPISODE = "protocol.md, An episode, 1"


@rule(
    "S1.1",
    "A free server answers a discovery of a simulation that it offers.",
    where=EPISODE,
    mend="subscribe to discovery; publish on server when the title is one of yours and the "
    "requirements are fulfilled",
)
def answers(server: Server) -> None:
    """One discovery, any answer with the server's ID."""
    question = server.discovery()
    sent = f"discovery {json.dumps(question)}"
    server.client.send("discovery", **question)
    answer = server.client.next(server.is_answer, server.settings.timeout)
    if answer is None:
        came = f"nothing came within {server.settings.timeout:g} s"
        raise Failure(came, f"a message on server with server {server.id}", sent)
    server.capabilities = {}
    found = answer.json.get("capabilities")
    if isinstance(found, dict):
        server.capabilities = found


@rule(
    "S1.2",
    "The answer has the hash of the discovery, so that the tool knows which question it answers.",
    where="protocol.md, Topics",
    mend="copy simulation_hash from the discovery into the answer, as it is",
    needs=["S1.1"],
)
def echoes(server: Server) -> None:
    """Two discoveries with different hashes."""
    for _ in range(2):
        question = server.discovery()
        sent = server.client.send("discovery", **question)
        answer = server.client.next(server.is_answer, server.settings.timeout)
        if answer is None:
            raise Failure("nothing came", "an answer to each discovery", sent)
        if answer.json.get("simulation_hash") != question["simulation_hash"]:
            raise Failure(f"{answer} came", f'"simulation_hash": "{question["simulation_hash"]}"', sent)


@rule(
    "S1.3",
    "The answer has all its keys: server, simulation_hash, simulations with the title, capabilities "
    "with dimensions.",
    where="protocol/schemas/server.schema.json",
    mend="send every key that is required, with the type that the schema says",
    needs=["S1.2"],
)
def has_its_keys(server: Server) -> None:
    """The shape of the answer."""
    answer = server.must_answer("an answer")
    text = f"server {shown(json.dumps(answer))} came"
    titles, capabilities = answer.get("simulations"), answer.get("capabilities")
    if not isinstance(titles, list) or not all(isinstance(title, str) for title in titles):
        raise Failure(text, '"simulations" is a list of titles')
    if server.settings.title not in titles:
        raise Failure(text, f'"simulations" has "{server.settings.title}", which was asked for')
    if not isinstance(capabilities, dict) or not is_number(capabilities.get("dimensions")):
        raise Failure(text, '"capabilities" is an object with the number "dimensions"')
    if capabilities["dimensions"] != server.settings.dimensions:
        raise Failure(text, f'"dimensions" is {server.settings.dimensions:g}, as the discovery required')
    for key in ("max_agents", "max agents"):
        if key in capabilities and not is_number(capabilities[key]):
            raise Failure(text, f'"{key}" is a number, or left out for no limit')


@rule(
    "S1.4",
    "It does not answer a discovery of a simulation that it does not offer.",
    where=EPISODE,
    mend="compare the discovery's simulation with your titles, letter by letter",
    needs=["S1.2"],
)
def other_title(server: Server) -> None:
    """Titles that are nearly right."""
    title = server.settings.title
    others = [f"{title}2", "", f"no {title}"]
    server.must_not_answer((server.discovery(simulation=other) for other in others), "another simulation")


@rule(
    "S1.5",
    "It does not answer when another number of dimensions is required.",
    where=EPISODE,
    mend="answer only when requirements.dimensions equals the dimensions of your capabilities",
    needs=["S1.2"],
)
def other_dimensions(server: Server) -> None:
    """One dimension more, one less, half a dimension more."""
    own = server.settings.dimensions
    others = [server.discovery(requirements={"dimensions": own + more}) for more in (1, -1, 0.5)]
    server.must_not_answer(others, f"it has {own:g} dimensions")


@rule(
    "S1.6",
    "It answers when no more agents are required than it announces as max_agents, and not when more are.",
    where=EPISODE,
    mend="answer only when your max_agents is at least that of the requirements; either may be left out",
    needs=["S1.2"],
)
def many_agents(server: Server) -> None:
    """Exactly as many agents, and one more; in both spellings."""
    most, dimensions = server.max_agents, server.settings.dimensions
    required = 1_000_000 if most is None else most
    for key in ("max_agents", "max agents"):
        changes = {"requirements": {"dimensions": dimensions, key: required}}
        server.must_answer(
            f'an answer: "{key}" is not above what it announces', json.dumps(changes), **changes
        )
    if most is None:
        raise Skip("the server announces no max_agents: no limit")
    tries = [
        server.discovery(requirements={"dimensions": dimensions, key: most + 1})
        for key in ("max_agents", "max agents")
    ]
    server.must_not_answer(tries, f"it simulates {most:g} agents at most")


@rule(
    "S1.7",
    "A hash is any text.",
    where="protocol.md, Hash",
    mend="keep simulation_hash as the text that it is; do not expect 64 hexadecimal digits",
    needs=["S1.2"],
)
def any_hash(server: Server) -> None:
    """Short, long, with quotes, backslashes and letters beyond ASCII."""
    for start in ("x", "ä ☃ 🤖", 'say "\\n"', "long " * 400):
        hash_ = start + new_hash()[:8]
        sent = f'discovery with "simulation_hash": {shown(json.dumps(hash_))}'
        server.must_answer("an answer with this hash", sent, simulation_hash=hash_)


@rule(
    "S1.8",
    "Unknown keys are ignored, and of repeated keys the last one counts.",
    where="protocol.md, Reading",
    mend="read the keys that you know, ignore the others; most JSON libraries keep the last of repeated keys",
    needs=["S1.2"],
)
def tolerant(server: Server) -> None:
    """A discovery with keys that nobody knows, then one with the wrong title before the right one."""
    server.must_answer(
        "an answer",
        "discovery with the unknown keys note and deep",
        note="?",
        deep={"simulation": [1, {"run": None}]},
    )
    question = server.discovery()
    text = json.dumps({**question, "first": 1}).replace("{", '{"simulation": "nobody has this", ', 1)
    server.client.publish("discovery", text)
    hash_ = question["simulation_hash"]
    if not server.client.next(lambda message: server.is_answer(message, hash_), server.settings.timeout):
        raise Failure(
            "nothing came", "an answer: the last of two keys simulation counts", f"discovery {text}"
        )
