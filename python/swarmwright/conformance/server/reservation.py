"""S6: reservations and their duration."""

import time

from swarmwright.conformance._extensions import decode_message
from swarmwright.conformance._server_under_test import Episode, Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begin_episode
from swarmwright.conformance.server.presence import skip_without_presence
from swarmwright.servers.broker.client import TO_TOOL, Failure, Message

LONGEST_REASON = 2000
TAKEN = "protocol.md, Reservation of servers"
HOLD_S = 5.0
"""Seconds for which parameters without control, or a named tool, reserve a server."""
TURN_S = 5.0
"""Seconds after which another tool that requests the server gets it."""


def must_be_taken(server: Server, why: str, sent: str = "", **changes: object) -> None:
    """Raise Failure if the server answers a discovery now."""
    question = server.discovery(**changes)
    discovery = server.client.send("discovery", **question)
    message = server.client.next(
        lambda message: server.is_answer(message, question["simulation_hash"]), server.quiet
    )
    if message is not None:
        before = f"{sent}, then " if sent else ""
        raise Failure(f"it answered a discovery: {message}", f"silence: {why}", before + discovery)


def must_be_free_within(server: Server, seconds: float, why: str, sent: str) -> float:
    """Repeat the discovery; return the seconds until an answer. Raises Failure without one."""
    start = time.monotonic()
    while time.monotonic() < start + seconds:
        if server.is_free(within=0.25):
            return time.monotonic() - start
    raise Failure(f"it answered no discovery for {seconds:g} s", why, sent)


@rule(
    "S6.1",
    "After parameters it does not answer discovery.",
    where=TAKEN,
    fix="count as reserved once parameters with your ID arrive",
    needs=["S2.10"],
)
def is_reserved_by_parameters(server: Server) -> None:
    """Send parameters, then a discovery."""
    episode = server.episode()
    sent = episode.configure()
    must_be_taken(server, "it is taken since the parameters", sent)
    episode.stop()


@rule(
    "S6.2",
    "During an episode it answers no tool's discovery.",
    where=TAKEN,
    fix="answer discovery only between episodes",
    d61="5.2.3; 7.2.2",
    needs=["S2.9"],
)
def while_running(server: Server) -> None:
    """Send discoveries in the first and the second step."""
    episode = begin_episode(server)
    must_be_taken(server, "an episode is under way")
    for agent, turn, numbers in list(episode.pending):
        episode.answer(agent, server.policy(agent, turn, numbers))
    episode.receive()
    if not episode.over:
        must_be_taken(server, "an episode is under way")
    episode.stop()


@rule(
    "S6.3",
    "During an episode, another tool's parameters and control with run: false change nothing.",
    where=TAKEN,
    fix="refuse control with another hash during an episode",
    needs=["S2.9"],
)
def ignores_other_tools(server: Server) -> None:
    """Send another tool's parameters and run: false."""
    episode, other = begin_episode(server), server.episode()
    sent = f"{other.configure()}, then {other.stop()}"
    other.over = True
    server.must_be_silent("another tool has the server", sent, but=episode)
    try:
        trajectory = episode.play()
    except Failure as failure:
        raise Failure(failure.came, "the episode goes on", sent) from None
    difference = server.reference.difference(trajectory) if server.deterministic else ""
    if difference:
        raise Failure(difference, "the episode of the tool that was first", sent)


@rule(
    "S6.4",
    "If two tools send parameters, the first control wins.",
    where=TAKEN,
    fix="keep the parameters of several hashes; accept the first control for one of them",
    needs=["S2.9"],
)
def first_control_wins(server: Server) -> None:
    """Send parameters of A and B, then control of A and B; expect an episode for A only."""
    if server.trajectory is not None and not server.trajectory.messages:
        raise Skip("the simulation controls its agents itself, it may be over before the second control")
    first, second = server.episode(), server.episode()
    first.configure()
    second.configure()
    sent = f"{first.start()}, then {second.start()}"
    second.over = True
    received = server.client.drain(server.quiet)
    strays = [message for message in received if message.maybe.get("simulation_hash") == second.hash]
    if strays:
        raise Failure(f"{strays[0]} arrived", "no message for the tool whose control came second", sent)
    server.client.waiting.extend(received)
    first.play()


@rule(
    "S6.5",
    "Parameters without control reserve it for 5 s, not longer and not much shorter.",
    where=TAKEN,
    fix="become free 5 s after parameters without control",
    needs=["S6.1"],
    seconds=30,
)
def parameters_time_out(server: Server) -> str:
    """Send parameters, then discoveries until one is answered."""
    episode = server.episode()
    sent = episode.configure()
    start = time.monotonic()
    episode.over = True
    seconds = must_be_free_within(server, HOLD_S + 3, "free 5 s after parameters without control", sent)
    if seconds < HOLD_S - 1:
        raise Failure(f"it was free after {time.monotonic() - start:.1f} s", "taken for 5 s", sent)
    return f"free after {seconds:.1f} s"


@rule(
    "S6.6",
    "It aborts an episode without actuators after its time-out, without a fitness.",
    where=TAKEN,
    fix="measure the time since a step began; drop the episode after the time-out",
    needs=["S6.2"],
    seconds=60,
)
def gives_up(server: Server) -> str:
    """Send no actuators until the time-out."""
    patience = short_patience(server)
    episode = begin_episode(server)
    episode.over = True
    seconds = must_be_free_within(
        server, patience + 3, f"free after {patience:g} s without actuators", "no actuators"
    )
    episode.pass_over_late()
    server.must_be_silent("an episode that was given up has no fitness")
    return f"free after {seconds:.1f} s"


@rule(
    "S6.10",
    "It reports a failed episode on the tool's reply topic: kind, version, server, hash, reason.",
    where="protocol.md, Failures; protocol/schemas/failed.schema.json",
    fix="publish failed, a MessagePack map, on control's reply topic when an episode has no fitness",
    needs=["S6.6"],
    seconds=60,
)
def tells_of_failures(server: Server) -> str:
    """Start an episode with a reply topic and send no actuators until it is aborted."""
    skip_without_presence(server)
    patience = short_patience(server)
    if server.trajectory is not None and not server.trajectory.messages:
        raise Skip("the simulation controls its agents itself, no agent is waited for")
    episode = server.episode()
    episode.configure()
    sent = episode.start(reply=TO_TOOL + server.token)
    episode.over = True
    message = server.client.next(
        lambda message: message.topic == TO_TOOL + server.token, patience + server.settings.timeout
    )
    if message is None:
        came = f"no message came on the topic in reply within {patience + server.settings.timeout:g} s"
        raise Failure(came, "the message failed", f"{sent}, then no actuators")
    tells = decode_message(message)
    expected = {"kind": "failed", "version": 1, "server": server.id, "simulation_hash": episode.hash}
    for key, value in expected.items():
        if tells.get(key) != value:
            raise Failure(f'"{key}" is {tells.get(key)!r}', f"{value!r}", sent)
    if not isinstance(tells.get("reason"), str) or not 0 < len(tells["reason"]) <= LONGEST_REASON:
        raise Failure(
            f'"reason" is {tells.get("reason")!r}', f"text of 1 to {LONGEST_REASON} characters", sent
        )
    return str(tells["reason"]).partition("\n")[0]


def short_patience(server: Server) -> float:
    """Return the server's time-out of an episode; skip the rule if it is unknown or too long."""
    patience = server.settings.step_timeout
    if patience is None:
        raise Skip("give --step-timeout SECONDS, what the server was started with, 10 at most")
    if patience > 10:
        raise Skip(f"the server waits for {patience:g} s; start it with a shorter time-out, 10 s at most")
    return patience


def play_named(server: Server, tool: str) -> Episode:
    """Play an episode of a named tool, after which the server is reserved."""
    skip_without_presence(server)
    episode = server.episode(tool=tool)
    episode.configure()
    episode.start()
    episode.play()
    return episode


@rule(
    "S6.7",
    "It stays reserved for a tool that names itself, and answers only this tool's discovery.",
    where=TAKEN,
    fix="remember tool from control; while reserved, answer only discoveries with that tool",
    needs=["S2.8", "S2.9"],
)
def is_held(server: Server) -> None:
    """Play an episode of a named tool; then send discoveries of another, an unnamed and the same tool."""
    play_named(server, "conformance/a")
    must_be_taken(server, "it is held for conformance/a", tool="conformance/b")
    must_be_taken(server, "it is held for conformance/a")
    server.must_answer("an answer to its holder", "discovery of conformance/a", tool="conformance/a")
    other = server.episode(tool="conformance/b")
    sent = f"{other.configure()}, {other.start()}"
    other.over = True
    server.must_be_silent("it is held for conformance/a", sent)
    second_episode = server.episode(tool="conformance/a")
    second_episode.configure()
    second_episode.start()
    second_episode.play()


@rule(
    "S6.8",
    "Control with run: false from its holder frees it at once.",
    where=TAKEN,
    fix="while reserved, become free on run: false with the holder's tool",
    needs=["S6.7"],
)
def is_freed(server: Server) -> None:
    """Play an episode of a named tool, then send run: false."""
    episode = play_named(server, "conformance/a")
    sent = episode.stop()
    server.must_answer("an answer to every tool", sent)


@rule(
    "S6.11",
    "Control with run: false, unnamed or from another tool, does not end the episode of a named tool.",
    where=TAKEN,
    fix="compare tool of control with the episode's before you end it",
    needs=["S2.9", "S6.7"],
)
def ignores_unnamed_end(server: Server) -> None:
    """Send run: false unnamed and with another name during an episode."""
    _must_go_on(server, "conformance/a", [{}, {"tool": "conformance/b"}])


@rule(
    "S6.12",
    "Control with run: false from a named tool does not end the episode of an unnamed one.",
    where=TAKEN,
    fix="compare tool of control with the episode's, even if that has none",
    needs=["S2.9"],
)
def ignores_named_end(server: Server) -> None:
    """Send run: false with a name during an unnamed tool's episode."""
    _must_go_on(server, None, [{"tool": "conformance/b"}])


def _must_go_on(server: Server, tool: str | None, others: list[dict[str, str]]) -> None:
    """Play an episode of a tool, with run: false of others in the middle."""
    skip_without_presence(server)
    if server.trajectory is not None and not server.trajectory.messages:
        raise Skip("the simulation controls its agents itself, it may be over before it could be ended")
    episode = server.episode(tool=tool)
    episode.configure()
    episode.receive(episode.start())
    fields = {"server": server.id, "simulation_hash": episode.hash, "run": False}
    sent = ", then ".join(server.client.send("control", **fields, **other) for other in others)
    owner = tool or "the tool without a name"
    try:
        trajectory = episode.play()
    except Failure as failure:
        raise Failure(failure.came, f"the episode of {owner} goes on", sent) from None
    difference = server.reference.difference(trajectory) if server.deterministic else ""
    if difference:
        raise Failure(difference, f"the episode of {owner}", sent)
    episode.stop()


@rule(
    "S6.9",
    "If its holder does not return, it is free for every tool after 5 s.",
    where=TAKEN,
    fix="become free 5 s after the end of the episode",
    needs=["S6.7"],
    seconds=30,
)
def hold_ends(server: Server) -> str:
    """Play an episode of a named tool, then send discoveries of others until one is answered."""
    play_named(server, "conformance/a")
    seconds = must_be_free_within(server, HOLD_S + 3, "free 5 s after the episode", "an episode with a name")
    if seconds < HOLD_S - 1:
        raise Failure(f"it was free for others after {seconds:.1f} s", "held for 5 s")
    return f"free after {seconds:.1f} s"


@rule(
    "S6.13",
    "Two named tools share it in turns: after 5 s, it answers the waiting tool instead of the first.",
    where=TAKEN,
    fix="note the holder's start and who asked within 3 s; after 5 s, between episodes, reserve for "
    "the longest waiting tool for 3 s",
    needs=["S6.5", "S6.7", "S6.9"],
    seconds=40,
)
def takes_turns(server: Server) -> str:
    """Play one tool's episodes in succession, with discoveries of another tool between them."""
    start = time.monotonic()
    hashes: set[str] = set()
    sent = "episodes of conformance/a, and between them discoveries of conformance/b"
    while time.monotonic() < start + TURN_S + 3 or len(hashes) < 2:
        play_named(server, "conformance/a")
        question = server.discovery(tool="conformance/b")
        hashes.add(question["simulation_hash"])
        server.client.send("discovery", **question)
        if server.client.next(lambda message: _answers(server, message, hashes), server.quiet):
            break
    else:
        raise Failure(f"conformance/b got no answer for {time.monotonic() - start:.1f} s", "its turn", sent)
    seconds = time.monotonic() - start
    if seconds < TURN_S - 1:
        raise Failure(f"conformance/b was answered after {seconds:.1f} s", "5 s for conformance/a", sent)
    server.client.drain()
    must_be_taken(server, "it is the turn of conformance/b", tool="conformance/a")
    play_named(server, "conformance/b")
    return f"the other one's turn after {seconds:.1f} s"


@rule(
    "S6.14",
    "Control that arrives before its parameters waits for them for 1 s.",
    where="protocol.md, Reservation of servers; protocol.md, Order",
    fix="keep control without parameters for 1 s: brokers may reorder messages of two topics",
    needs=["S2.11"],
)
def waits_for_parameters(server: Server) -> None:
    """Send control, then its parameters."""
    skip_without_presence(server)
    episode = server.episode()
    sent = f"{episode.start()}, then {episode.configure()}"
    episode.receive(sent)
    episode.play()


@rule(
    "S6.15",
    "Control with a reply topic starts one episode; repeated after the fitness, it starts nothing.",
    where="protocol.md, An episode",
    fix="remember the hashes started with reply and ignore repetitions",
    needs=["S2.8"],
)
def plays_once(server: Server) -> None:
    """Send control with a reply topic, play the episode, then send the same control again."""
    skip_without_presence(server)
    episode = server.episode()
    episode.configure()
    episode.start(reply=TO_TOOL + server.token)
    episode.play()
    sent = episode.start(reply=TO_TOOL + server.token)
    server.must_be_silent("the episode of this hash was played, and its control had reply", sent)
    episode.stop()


def _answers(server: Server, message: Message, hashes: set[str]) -> bool:
    return server.is_answer(message) and message.maybe.get("simulation_hash") in hashes
