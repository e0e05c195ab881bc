"""S11: connections that break, brokers that restart, messages retained on a broker."""

import json
import time
from contextlib import suppress

import msgpack

from swarmwright.common.json_text import Json, new_hash
from swarmwright.conformance._extensions import TOOL, batch, evaluation
from swarmwright.conformance._proxy import Door
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import NotTried, Skip
from swarmwright.conformance.server._evaluations import announced_controllers
from swarmwright.conformance.server._retained import kept
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begun
from swarmwright.servers.broker.client import PRESENCE, TO_TOOL, Failure, Message, shown

BACK_S = 15.0
"""Seconds in which a server is back when the broker is."""
BROKER = "decision 003"


def door(server: Server) -> Door:
    """The proxy between server and broker; skips the rule where there is none."""
    if server.door is None:
        raise Skip(
            "the kit is not between server and broker: let it start a broker, or start the server (--exec)"
        )
    return server.door


def must_come_back(server: Server, why: str) -> float:
    """Open the proxy and ask until it answers; after how many seconds it did."""
    door(server).open()
    start = time.monotonic()
    while time.monotonic() < start + BACK_S:
        if server.discover(within=0.1) is not None:
            return time.monotonic() - start
    raise Failure(f"it answered no discovery within {BACK_S:g} s after the broker was back", "an answer", why)


@rule(
    "S11.1",
    "It connects again when the connection broke.",
    where=BROKER,
    fix="let the MQTT client connect again by itself, and subscribe again whenever it is connected",
    needs=["S2.3"],
    seconds=40,
)
def connects_again(server: Server) -> str:
    """The connection is cut; the broker can be reached again at once."""
    door(server).shut()
    seconds = must_come_back(server, "the connection was cut")
    server.play()
    return f"back after {seconds:.1f} s"


@rule(
    "S11.2",
    "It waits for a broker that is unavailable for seconds.",
    where=BROKER,
    fix="try again without end, with pauses of seconds",
    needs=["S11.1"],
    seconds=40,
)
def waits(server: Server) -> str:
    """Three seconds without a broker."""
    door(server).shut()
    time.sleep(3)
    seconds = must_come_back(server, "the broker was unavailable for 3 s")
    server.play()
    return f"back after {seconds:.1f} s"


@rule(
    "S11.3",
    "When its connection breaks, its last will says that it is lost; back, it is ready.",
    where="protocol.md, Presence",
    fix='give the client a last will: presence, retained, with the state "lost"',
    needs=["S11.1"],
    seconds=40,
)
def last_will(server: Server) -> None:
    """What presence says while the connection is cut, and afterwards."""
    topic = f"{PRESENCE}{server.id}"
    if not kept(server, [topic]):
        raise Skip("not announced: no presence")
    door(server).shut()
    _must_say(server, "lost", "the connection was cut")
    must_come_back(server, "the connection was cut")
    _must_say(server, "ready", "the connection was cut and is back")


def _must_say(server: Server, wanted: str, sent: str) -> None:
    limit = time.monotonic() + server.settings.timeout
    state: object = None
    while time.monotonic() < limit:
        found = kept(server, [f"{PRESENCE}{server.id}"])
        state = found[-1].json.get("state") if found else None
        if state == wanted:
            return
    raise Failure(f'presence says "{state}"', f'"{wanted}"', sent)


@rule(
    "S11.4",
    "A message with the retain flag was left by another client: it is ignored.",
    where="protocol.md, Topics",
    fix="look at the retain flag of each message; take none but presence with it",
    needs=["S11.1"],
    seconds=40,
)
def leftovers(server: Server) -> None:
    """Retained discovery, parameters, control and a request, which it gets when it comes back."""
    gate, client, hash_ = door(server), server.client, new_hash()
    server.episode(hash_=hash_)  # so that it is ended if it was begun
    mine = {"server": server.id, "simulation_hash": hash_}
    left: dict[str, str | bytes] = {
        "discovery": json.dumps(server.discovery(simulation_hash=hash_)),
        "parameters": json.dumps({**server.settings.parameters, **mine}),
        "control": json.dumps({**mine, "simulation": server.settings.title, "run": True}),
    }
    if request := _request(server):
        left[server.own_topic] = msgpack.packb(request)
        server.tools.add(TOOL)
    sent = "; ".join(
        f"{topic} {shown(payload) if isinstance(payload, str) else f'({len(payload)} bytes)'} (retained)"
        for topic, payload in left.items()
    )
    gate.shut()
    wrong: list[Message] = []

    def is_wrong(message: Message) -> bool:
        return message.topic == TO_TOOL + server.token or message.maybe.get("simulation_hash") == hash_

    try:
        for topic, payload in left.items():
            client.publish(topic, payload, retain=True)
        client.drain(server.quiet)
        gate.open()
        question = server.discovery()
        last = question["simulation_hash"]
        limit = time.monotonic() + BACK_S
        answer = None
        while answer is None and time.monotonic() < limit:
            client.send("discovery", **question)
            answer = client.next(
                lambda message: is_wrong(message) or message.maybe.get("simulation_hash") == last, 0.1
            )
        if answer is None:
            raise Failure(
                "it no longer answered discoveries", "an answer to a discovery that is not retained", sent
            )
        wrong = [message for message in (answer, *client.drain(server.quiet)) if is_wrong(message)]
    finally:
        for topic in left:
            client.publish(topic, b"", retain=True)
    if wrong:
        came = "an answer to the request" if wrong[0].topic == TO_TOOL + server.token else str(wrong[0])
        raise Failure(f"{came} came", "silence: the message was retained", sent)


def _request(server: Server) -> Json | None:
    """A request that the server would answer; None where it announces no mode with requests."""
    modes = server.announced.get("modes", [])
    if "batched" in modes:
        return batch(server, [1])
    if "offloaded" in modes:
        with suppress(Skip, NotTried):
            return evaluation(server, announced_controllers(server, 1), [1])
    return None


@rule(
    "S11.5",
    "An episode whose connection broke does not keep the server for ever: control with run: false frees it.",
    where="protocol.md, Who is taken, and when",
    fix="give up the episode when the connection breaks, or listen to its end when it is back",
    needs=["S11.1", "S2.9"],
    seconds=40,
)
def cut_short(server: Server) -> None:
    """A cut in the middle of an episode, then its end, then another episode."""
    episode = begun(server)
    door(server).shut()
    door(server).open()
    limit = time.monotonic() + BACK_S
    while time.monotonic() < limit:
        sent = episode.stop()
        if server.discover(within=0.1) is not None:
            break
    else:
        raise Failure(
            f"it answered no discovery for {BACK_S:g} s", "free again", f"the connection was cut, then {sent}"
        )
    trajectory = server.play()
    difference = server.reference.difference(trajectory) if server.deterministic else ""
    if difference:
        raise Failure(
            difference, "an episode like any other", "an episode after the connection was cut in another"
        )
