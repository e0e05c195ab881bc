"""S11 to S13 and S16: broken connections, broker restarts, retained messages, time-outs, speed, shutdown."""

import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from statistics import median

import msgpack

from swarmwright import _engine
from swarmwright.common.json_text import Json, new_hash
from swarmwright.conformance._extensions import TOOL, batch, controller_set, evaluation
from swarmwright.conformance._peers import GRACE_S, Door
from swarmwright.conformance._server_under_test import Server, ServerPeer
from swarmwright.conformance.rules import Note, NotTried, Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begin_episode
from swarmwright.conformance.server.offloaded import list_controllers
from swarmwright.conformance.server.presence import presence, read_retained
from swarmwright.servers.broker.client import PRESENCE, TO_TOOL, Failure, Message, format_payload

BACK_S = 15.0
"""Seconds within which a server reconnects to a restored broker."""
BROKER = "decision 003"


def door(server: Server) -> Door:
    """Return the proxy between server and broker; skip the rule if there is none."""
    if server.door is None:
        raise Skip(
            "the kit is not between server and broker: let it start a broker, or start the server (--exec)"
        )
    return server.door


def must_come_back(server: Server, why: str) -> float:
    """Open the proxy and repeat the discovery; return the seconds until an answer."""
    door(server).open()
    start = time.monotonic()
    while time.monotonic() < start + BACK_S:
        if server.discover(within=0.1) is not None:
            return time.monotonic() - start
    raise Failure(f"it answered no discovery within {BACK_S:g} s after the broker was back", "an answer", why)


@rule(
    "S11.1",
    "It reconnects after the connection broke.",
    where=BROKER,
    fix="let the MQTT client reconnect, and subscribe on every connection",
    needs=["S2.3"],
    seconds=40,
)
def connects_again(server: Server) -> str:
    """Cut the connection; the broker is reachable again at once."""
    door(server).shut()
    seconds = must_come_back(server, "the connection was cut")
    server.play()
    return f"back after {seconds:.1f} s"


@rule(
    "S11.2",
    "It waits for a broker that is unavailable for seconds.",
    where=BROKER,
    fix="retry forever, with pauses of seconds",
    needs=["S11.1"],
    seconds=40,
)
def waits(server: Server) -> str:
    """Make the broker unreachable for three seconds."""
    door(server).shut()
    time.sleep(3)
    seconds = must_come_back(server, "the broker was unavailable for 3 s")
    server.play()
    return f"back after {seconds:.1f} s"


@rule(
    "S11.3",
    "When its connection breaks, its last will reports it as lost; after reconnecting, it is ready.",
    where="protocol.md, Presence",
    fix='give the client a last will: presence, retained, with the state "lost"',
    needs=["S11.1"],
    seconds=40,
)
def last_will(server: Server) -> None:
    """Read presence while the connection is cut, and afterwards."""
    topic = f"{PRESENCE}{server.id}"
    if not read_retained(server, [topic]):
        raise Skip("not announced: no presence")
    door(server).shut()
    _must_say(server, "lost", "the connection was cut")
    must_come_back(server, "the connection was cut")
    _must_say(server, "ready", "the connection was cut and is back")


def _must_say(server: Server, expected: str, sent: str) -> None:
    limit = time.monotonic() + server.settings.timeout
    state: object = None
    while time.monotonic() < limit:
        messages = read_retained(server, [f"{PRESENCE}{server.id}"])
        state = messages[-1].json.get("state") if messages else None
        if state == expected:
            return
    raise Failure(f'presence says "{state}"', f'"{expected}"', sent)


@rule(
    "S11.4",
    "Retained messages, which another client left, are ignored.",
    where="protocol.md, Topics",
    fix="check the retain flag; accept only presence with it",
    needs=["S11.1"],
    seconds=40,
)
def leftovers(server: Server) -> None:
    """Retain discovery, parameters, control and a request, which the server gets when it reconnects."""
    gate, client, hash_ = door(server), server.client, new_hash()
    server.episode(hash_=hash_)  # so that the episode is ended if it was started
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
        f"{topic} {format_payload(payload) if isinstance(payload, str) else f'({len(payload)} bytes)'} "
        "(retained)"
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
        raise Failure(f"{came} arrived", "silence: the message was retained", sent)


def _request(server: Server) -> Json | None:
    """Build a request that the server would answer; None if it announces no mode with requests."""
    modes = server.announced.get("modes", [])
    if "batched" in modes:
        return batch(server, [1])
    if "offloaded" in modes:
        with suppress(Skip, NotTried):
            return evaluation(server, list_controllers(server, 1), [1])
    return None


@rule(
    "S11.5",
    "An episode whose connection broke does not block the server: control with run: false frees it.",
    where="protocol.md, Reservation of servers",
    fix="drop the episode when the connection breaks, or accept its end afterwards",
    needs=["S11.1", "S2.9"],
    seconds=40,
)
def cut_short(server: Server) -> None:
    """Cut the connection during an episode, end the episode, then play another one."""
    episode = begin_episode(server)
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


WHERE = "protocol.md, Two servers with one ID"
LEAVES_WITHIN_S = 30.0
"""Seconds for a process to start, find another server with its ID, and exit."""
OTHER = "another-instance"
"""The instance of the other server, played by the kit."""


def instance(server: Server) -> str:
    """Return the server's instance; skip the rule if it announces none."""
    server.announces()
    if not server.instance:
        raise Skip("not announced: capabilities.swarmwright.instance")
    return server.instance


@rule(
    "S16.1",
    "Control for another instance of the server starts nothing.",
    where=WHERE,
    fix="compare instance of control, if present, with yours",
    needs=["S2.3"],
)
def another_instance(server: Server) -> None:
    """Send parameters, control with another instance, then control with the announced instance."""
    mine = instance(server)
    episode = server.episode()
    episode.configure()
    sent = episode.start(instance=OTHER)
    messages = [message for message in server.client.drain(server.quiet) if episode.is_mine(message)]
    if messages:
        raise Failure(f"{messages[0]} arrived", "silence: another instance of the server is meant", sent)
    episode.receive(episode.start(instance=mine))
    episode.play()


@rule(
    "S16.2",
    "A server whose ID is in use exits on start with a status other than 0, leaving the other's "
    "presence alone.",
    where=WHERE,
    fix="listen to your presence topic for 0.1 s on start; if another instance is ready or busy, exit "
    "without publishing presence or a last will",
    needs=["S7.2"],
    seconds=60,
)
def second_leaves(server: Server) -> str:
    """Run the command of --exec a second time."""
    mine = instance(server)
    if server.process is None:
        raise Skip("the kit did not start the server (--exec)")
    second, own = server.process.another(), presence(server)
    sent = f"the server was started once more with the ID {server.id}"
    try:
        second.start()
        status = second.wait(LEAVES_WITHIN_S)
    finally:
        second.close()
        instances = [
            _instance_of(message.json) for message in read_retained(server, [f"{PRESENCE}{server.id}"])
        ]
        if instances != [mine]:
            _publish(server, own)
    if status is None:
        raise Failure(f"the second one still ran {LEAVES_WITHIN_S:g} s later", "its end", sent)
    if status == 0:
        raise Failure("the second one ended with exit status 0", "another exit status", sent)
    if instances != [mine]:
        state = f'is of instance "{instances[0]}"' if instances else "is removed"
        raise Failure(f"presence {state} now", f'that of the first one, "{mine}"', sent)
    server.must_answer("an answer of the first one", sent)
    return f"exit status {status}"


@rule(
    "S16.3",
    "If it reconnects and finds another server's presence under its ID, it publishes lost, and "
    "continues unless the other objects.",
    where=WHERE,
    fix="after reconnecting, listen to your presence topic for 0.1 s; if another instance is ready or "
    "busy, publish lost, and ready if nothing arrives within 1 s",
    needs=["S7.2", "S11.3"],
    seconds=60,
)
def publishes_lost(server: Server) -> None:
    """Cut the connection and retain the presence of another server, which does not exist."""
    mine = instance(server)
    with _rival(server):
        sent = "the presence of another instance was retained while the connection was cut"
        _must_publish(server, mine, "lost", sent)
        must_come_back(server, sent)
        _must_publish(server, mine, "ready", sent)


@rule(
    "S16.4",
    "If another server with its ID then objects, it exits with a status other than 0, leaving the "
    "other's presence alone.",
    where=WHERE,
    fix="exit if, after reconnecting, another instance publishes ready or busy on your presence topic; "
    "do not clear presence",
    needs=["S16.3"],
    seconds=60,
)
def gives_way(server: ServerPeer) -> str:
    """Do the same, but let the other server publish its presence again."""
    mine = instance(server)
    if server.process is None:
        raise Skip("the kit did not start the server (--exec)")
    with _rival(server) as other:
        _must_publish(server, mine, "lost", "the presence of another instance was retained")
        _publish(server, other)
        sent = "then the other server published its presence again"
        status = server.process.wait(server.settings.timeout + LEAVES_WITHIN_S / 3)
        if status is None:
            raise Failure("it still ran", "its end", sent)
        present = _instance_of(presence(server))
    server.prepare_retry()
    if status == 0:
        raise Failure("it ended with exit status 0", "another exit status", sent)
    if present != OTHER:
        raise Failure(f'presence is of instance "{present}" now', f'that of the other one, "{OTHER}"', sent)
    return f"exit status {status}"


@rule(
    "S16.5",
    "It corrects a late last will of its own instance.",
    where=WHERE,
    fix="if presence of your instance says lost while you are connected, publish presence again: a "
    "bridge may deliver the last will of a replaced connection",
    needs=["S7.2"],
)
def late_will(server: Server) -> None:
    """Publish the server's presence with state lost, retained."""
    mine = instance(server)
    own = presence(server)
    server.client.drain(server.quiet)
    _publish(server, {**own, "state": "lost"})
    sent = "its own presence was retained with the state lost"
    try:
        _must_publish(server, mine, "lost", sent)  # the presence that was just published
        _must_publish(server, mine, "ready", sent)
    except Failure:
        _publish(server, own)  # otherwise tools would no longer use the server
        raise


def _instance_of(message: Json) -> object:
    announced = (message.get("capabilities") or {}).get("swarmwright") or {}
    return announced.get("instance", message.get("instance"))


def _publish(server: Server, message: Json) -> None:
    server.client.publish(f"{PRESENCE}{server.id}", json.dumps(message).encode(), retain=True)


@contextmanager
def _rival(server: Server) -> Iterator[Json]:
    """Cut the connection and retain the presence of another server; yield that presence."""
    gate, own = door(server), presence(server)
    capabilities = own["capabilities"]
    elsewhere = {"instance": OTHER, "host": "another-host", "pid": 1}
    announced = {**capabilities["swarmwright"], **elsewhere}
    other = {
        **own,
        **elsewhere,
        "state": "ready",
        "capabilities": {**capabilities, "swarmwright": announced},
    }
    gate.shut()
    try:
        # Its last will would replace the other presence.
        _must_publish(server, server.instance, "lost", "the connection was cut")
        _publish(server, other)
        server.client.drain(server.quiet)
        gate.open()
        yield other
    finally:
        gate.open()
        if any(
            _instance_of(message.json) == OTHER
            for message in read_retained(server, [f"{PRESENCE}{server.id}"])
        ):
            server.client.publish(f"{PRESENCE}{server.id}", b"", retain=True)


def _must_publish(server: Server, mine: str, expected: str, sent: str) -> None:
    """Wait for the next presence of this server. Raises Failure if its state is another one."""

    def is_own(message: Message) -> bool:
        return (
            message.topic == f"{PRESENCE}{server.id}"
            and bool(message.payload)
            and _instance_of(message.json) == mine
        )

    limit = time.monotonic() + server.settings.timeout + LEAVES_WITHIN_S / 2
    message = server.client.next(is_own, limit - time.monotonic())
    if message is None:
        raise Failure(f'its presence did not say "{expected}"', f'presence with the state "{expected}"', sent)
    state = message.json.get("state")
    if state != expected:
        raise Failure(f'presence says "{state}"', f'"{expected}" first', sent)


MEASUREMENT_S = 0.5
"""Target duration of a measurement in seconds."""
STEPS = 15
"""Steps over which the time between sensor messages is measured."""
LISTENING_S = 0.12
"""Seconds within which the sensor messages of a step arrive, including delayed acknowledgements (40 ms on
Linux)."""
HELD_BACK_S = 0.03
"""Seconds between the sensor messages of a step from which they seem to be held back."""


def _measure(server: Server, mode: str) -> str:
    server.announces(mode=mode)
    steps = server.reference.messages / len(server.reference.readings)
    if server.own_broker is None:
        raise Skip("other clients use this broker; let the kit start one")
    kinds = server.announced.get("controllers", ["layered"]) if mode == "offloaded" else ["layered"]
    if "layered" not in kinds:
        raise Skip("not announced: capabilities.swarmwright.controllers lacks 'layered'")
    pool = _engine.Pool(
        server.own_broker,
        simulation=server.settings.title,
        parameters=server.settings.parameters,
        requirements={"dimensions": server.settings.dimensions},
        sensors=server.sensors,
        actuators=server.actuators,
        prefix=server.prefix,
        tool="conformance/a",
        mode=mode,
        timeouts={"step": max(1.0, server.settings.timeout)},
        alone=True,
    )
    server.tools.add("conformance/a")
    try:
        pool.wait_for_server()
        count, seconds, rate = 1, 0.0, 0.0
        while seconds < MEASUREMENT_S / 4:
            count = max(
                count * 2, min(100_000, int(count * MEASUREMENT_S / max(seconds, MEASUREMENT_S / 64)))
            )
            controllers = controller_set(server, "layered", count)
            start = time.perf_counter()
            pool.evaluate(controllers.architecture, controllers.weights, [1])
            seconds = time.perf_counter() - start
            rate = count / seconds
            if count >= 100_000:
                break
    finally:
        pool.close()
    measured = f"{count} episodes of {steps:.0f} steps in {seconds:.2f} s"
    return f"{_short(rate)} episodes/s, {_short(rate * steps)} steps/s ({measured})"


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


_MODES = (
    ("S12.1", "stepwise", "switch Nagle's algorithm off (TCP_NODELAY)", "S2.8"),
    ("S12.2", "batched", "step the episodes of a batch side by side", "S10.1"),
    ("S12.3", "offloaded", "evaluate the candidates of a request without messages in between", "S9.1"),
)
"""For each mode: the id of its rule, advice, and the rule that it needs."""


def _register_mode(number: str, mode: str, advice: str, need: str) -> None:
    @rule(
        number,
        f"{mode.capitalize()}: episodes and steps per second (measured, not judged).",
        where="explanation/performance.md",
        fix=advice,
        needs=[need],
        seconds=60,
    )
    def _measure_mode(server: Server) -> str:
        """Evaluate layered networks in a mode, as an optimization tool would."""
        return _measure(server, mode)


for _row in _MODES:
    _register_mode(*_row)


@rule(
    "S12.4",
    "Stepwise: time between the first and the last sensor message of a step (measured, not judged).",
    where="Topics",
    fix="switch Nagle's algorithm off (TCP_NODELAY)",
    needs=["S2.8"],
    seconds=30,
)
def measure_spread(server: Server) -> Note:
    """Answer agents only when all were asked, since earlier answers would carry acknowledgements."""
    agents = len(server.reference.readings)
    episode = server.episode()
    episode.configure()
    sent = episode.start()
    spans: list[float] = []
    while len(spans) < STEPS and not episode.over and episode.receive(sent):
        first = episode.last_at
        # Answer no later than necessary, since a delay would make the server acknowledge the next messages at
        # once.
        while len(episode.pending) < agents:
            message = server.client.next(episode.is_mine, max(server.quiet, LISTENING_S))
            if message is None or not episode.take(message):
                break
        agents = len(episode.pending)
        if agents > 1:
            spans.append(episode.last_at - first)
        for agent, turn, sensors in list(episode.pending):
            sent = episode.answer(agent, server.policy(agent, turn, sensors))
    if not episode.over:
        episode.stop()
    if not spans:
        raise Skip("no step asks several agents; give parameters with several agents (--parameters)")
    span = median(spans)
    text = f"{span * 1e3:.1f} ms in the median of {len(spans)} steps"
    if span < HELD_BACK_S:
        return Note(text)
    why = "small packets seem to be held back (Nagle's algorithm): set TCP_NODELAY on the server's socket"
    return Note(f"{text}; {why}", doubt=f"{span * 1e3:.0f} ms between the sensor messages of a step: {why}")


@rule(
    "S13.1",
    "On SIGTERM, it removes its presence and exits.",
    where="protocol.md, Presence",
    fix="on SIGTERM, publish an empty retained presence message, disconnect, exit",
    needs=["S1.1"],
)
def leaves(server: Server) -> str:
    """Send SIGTERM to the process that the kit started."""
    if server.process is None:
        raise Skip("the kit did not start the server (--exec)")
    topic = f"{PRESENCE}{server.id}"
    announced = bool(read_retained(server, [topic]))
    server.left = True
    server.process.signal(signal.SIGTERM)
    if server.process.wait(GRACE_S) is None:
        raise Failure(f"it still ran {GRACE_S:g} s later", "its end", "SIGTERM")
    if not announced:
        return "no presence to be removed"
    left = read_retained(server, [topic])
    if left:
        raise Failure(f"the broker still keeps {left[0]}", "no presence message", "SIGTERM")
    return f"exit status {server.process.status}"
