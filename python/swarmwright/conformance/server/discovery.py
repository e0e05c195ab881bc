"""S1: answers to discoveries."""

import json
import time

from swarmwright.common.json_text import is_number, new_hash
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import Failure, Message, format_payload

EPISODE = "protocol.md, An episode, 1"


@rule(
    "S1.1",
    "A free server answers a discovery of a simulation that it offers.",
    where=EPISODE,
    fix="subscribe to discovery; publish on server if the title is yours and the requirements are fulfilled",
    d61="5.2.3; 6.2 Discovery message",
)
def answers(server: Server) -> None:
    """Send a discovery; accept any answer with the server's ID."""
    question = server.discovery()
    sent = f"discovery {json.dumps(question)}"
    server.client.send("discovery", **question)
    answer = server.client.next(server.is_answer, server.settings.timeout)
    if answer is None:
        came = f"nothing arrived within {server.settings.timeout:g} s"
        raise Failure(came, f"a message on server with server {server.id}", sent)
    server.note_capabilities(answer.json)


@rule(
    "S1.2",
    "The answer repeats the hash of the discovery.",
    where="protocol.md, Topics",
    fix="copy simulation_hash from the discovery unchanged",
    d61="6.2 Server message; 7.2.4, Schemas 8 and 9",
    needs=["S1.1"],
)
def echoes(server: Server) -> None:
    """Send two discoveries with different hashes. Answers to earlier ones may be late."""
    for _ in range(2):
        before = set(server.question_hashes)
        question = server.discovery()
        hash_ = question["simulation_hash"]
        sent = server.client.send("discovery", **question)
        limit = time.monotonic() + server.settings.timeout
        late: Message | None = None
        while answer := server.client.next(server.is_answer, max(limit - time.monotonic(), 0.0)):
            echoed = answer.json.get("simulation_hash")
            if echoed == hash_:
                break
            if not (isinstance(echoed, str) and echoed in before):
                raise Failure(f"{answer} arrived", f'"simulation_hash": "{hash_}"', sent)
            late = answer
        else:
            came = "nothing came" if late is None else f"{late} arrived, which answers an earlier discovery"
            raise Failure(came, "an answer to each discovery", sent)


@rule(
    "S1.3",
    "The answer has all keys: server, simulation_hash, simulations with the title, capabilities "
    "with dimensions.",
    where="protocol/schemas/server.schema.json",
    fix="send every required key with the type in the schema",
    d61="6.2 Server message, Schema 2",
    needs=["S1.2"],
)
def has_its_keys(server: Server) -> None:
    """Check the keys and types of the answer."""
    answer = server.must_answer("an answer")
    text = f"server {format_payload(json.dumps(answer))} arrived"
    titles, capabilities = answer.get("simulations"), answer.get("capabilities")
    if not isinstance(titles, list) or not all(isinstance(title, str) for title in titles):
        raise Failure(text, '"simulations" is a list of titles')
    if server.settings.title not in titles:
        raise Failure(text, f'"simulations" has "{server.settings.title}", which was asked for')
    if not isinstance(capabilities, dict) or not is_number(capabilities.get("dimensions")):
        raise Failure(text, '"capabilities" is an object with the number "dimensions"')
    for key in ("max_agents", "max agents"):
        if key in capabilities and not is_number(capabilities[key]):
            raise Failure(text, f'"{key}" is a number, or left out for no limit')


@rule(
    "S1.4",
    "It does not answer a discovery of another simulation.",
    where=EPISODE,
    fix="compare the discovery's simulation with your titles exactly",
    d61="6.2 Discovery message, Server message",
    needs=["S1.2"],
)
def ignores_other_titles(server: Server) -> None:
    """Send titles that are almost right."""
    title = server.settings.title
    others = [f"{title}2", "", f"no {title}"]
    server.must_not_answer((server.discovery(simulation=other) for other in others), "another simulation")


@rule(
    "S1.5",
    "It does not answer if another number of dimensions is required.",
    where=EPISODE,
    fix="answer only if requirements.dimensions equals your dimensions",
    needs=["S1.2"],
)
def ignores_other_dimensions(server: Server) -> None:
    """Require one dimension more, one less, and half a dimension more."""
    dimensions = server.settings.dimensions
    answer = server.must_answer("an answer")
    if answer.get("capabilities", {}).get("dimensions") != dimensions:
        raise Failure(
            f"server {format_payload(json.dumps(answer))} arrived",
            f'"dimensions" is {dimensions:g}, as the discovery required',
            f'discovery with "requirements": {{"dimensions": {dimensions:g}}}',
        )
    others = [server.discovery(requirements={"dimensions": dimensions + more}) for more in (1, -1, 0.5)]
    server.must_not_answer(others, f"it has {dimensions:g} dimensions")


@rule(
    "S1.6",
    "It answers if no more agents are required than its max_agents, and not if more are.",
    where=EPISODE,
    fix="answer only if max_agents is missing on either side or sufficient",
    d61="6.2 Discovery message, Schema 1; Server message, Schema 2",
    needs=["S1.2"],
)
def many_agents(server: Server) -> None:
    """Require exactly as many agents as announced, and one more, spelled as in Schema 1."""
    if server.max_agents is None:
        raise Skip("the server announces no max_agents: no limit")
    compare_agents(server, "max_agents", server.max_agents)


def compare_agents(server: Server, key: str, most: float) -> None:
    """Require as many agents as announced, then one more. Raises Failure if an answer is wrong."""
    needs = {"dimensions": server.settings.dimensions}
    fits = server.discovery(requirements={**needs, key: most})
    server.must_answer(
        f'an answer: "{key}" is not above what it announces',
        f"discovery {format_payload(json.dumps(fits))}",
        requirements=fits["requirements"],
    )
    many = server.discovery(requirements={**needs, key: most + 1})
    server.must_not_answer([many], f"it simulates {most:g} agents at most")


@rule(
    "S1.7",
    "A hash can be any text.",
    where="protocol.md, Hash",
    fix="treat simulation_hash as opaque text, not as 64 hexadecimal digits",
    d61="6.2 Discovery message, Schema 1",
    needs=["S1.2"],
)
def accepts_any_hash(server: Server) -> None:
    """Send hashes that are short, long, and with quotes, backslashes and non-ASCII letters."""
    for start in ("x", "ä ☃ 🤖", 'say "\\n"', "long " * 400):
        hash_ = start + new_hash()[:8]
        sent = f'discovery with "simulation_hash": {format_payload(json.dumps(hash_))}'
        server.must_answer("an answer with this hash", sent, simulation_hash=hash_)


@rule(
    "S1.8",
    "Unknown keys are ignored.",
    where="protocol.md, Reading",
    fix="read the keys that you know, ignore the others",
    d61="6.2, Schemas 1 to 7",
    needs=["S1.2"],
)
def tolerant(server: Server) -> None:
    """Send a discovery with unknown keys."""
    server.must_answer(
        "an answer",
        "discovery with the unknown keys note and deep",
        note="?",
        deep={"simulation": [1, {"run": None}]},
    )
