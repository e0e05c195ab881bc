"""Messages that a server must refuse, sent while it is free and during an episode."""

from collections.abc import Callable, Sequence

from swarmwright.common.json_text import new_hash
from swarmwright.conformance._server_peer import ServerPeer
from swarmwright.conformance.rules import Skip, WentOn
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
