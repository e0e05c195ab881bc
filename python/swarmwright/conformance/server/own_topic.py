"""S15: control messages on the server's own topic."""

import json

from swarmwright.common.json_text import Json
from swarmwright.conformance._server_peer import ServerPeer
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._disturb import Junk, disturb
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begun
from swarmwright.servers.broker.client import TO_SERVER, Failure

WHERE = "protocol.md, Presence; decision 023"


def announced(server: Server) -> None:
    """Skip the rule unless control messages on the own topic are announced."""
    server.announces()
    if server.announced.get("control") is not True:
        raise Skip("not announced: no capabilities.swarmwright.control")


@rule(
    "S15.1",
    "A server that announces control starts an episode at a control message on its own topic.",
    where=WHERE,
    fix="handle a JSON object on swarmwright/v1/server/{server} as a message on control; announce "
    "capabilities.swarmwright.control only then",
    needs=["S2.3"],
)
def starts(server: Server) -> None:
    """A whole episode that was started there, compared with one that was started on control."""
    announced(server)
    known = server.trajectory
    repeatable = known is not None and known.messages > 0 and server.repeatable
    episode = server.episode()
    episode.configure()
    sent = episode.start(server.own_topic)
    episode.receive(sent)
    trajectory = episode.play()
    difference = server.reference.difference(trajectory) if repeatable else ""
    if difference:
        raise Failure(difference, "the episode that a message on control starts", sent)


@rule(
    "S15.2",
    "Control with run: false ends an episode on either topic, whichever it was started on.",
    where=WHERE,
    fix="handle control messages of both topics by the same function: other tools use control",
    needs=["S15.1", "S2.9"],
)
def ends(server: Server) -> None:
    """Started on the own topic and ended on control, then the other way round."""
    announced(server)
    for first, second in ((server.own_topic, "control"), ("control", server.own_topic)):
        episode = begun(server, first)
        sent = episode.stop(second)
        try:
            server.must_come_free("free again", sent)
        except Failure:
            episode.over = False
            raise


@rule(
    "S15.3",
    "What is refused on control is refused on the server's own topic, too.",
    where=f"{WHERE}; protocol.md, Reading",
    fix="check every key of a control message on your own topic, server as well",
    needs=["S15.1", "S2.9"],
)
def refuses(server: ServerPeer) -> None:
    """Objects without a key, with a wrong type, for another server or episode; on another server's topic."""
    announced(server)

    def junk(hash_: str) -> list[Junk]:
        end: Json = {"server": server.id, "simulation_hash": hash_, "run": False}
        wrong: list[Json] = [
            *({name: value for name, value in end.items() if name != key} for key in end if key != "run"),
            {**end, "server": server.id + 1},
            {**end, "server": str(server.id)},
            {**end, "simulation_hash": hash_[::-1]},
            {**end, "run": "false"},
        ]
        here = [(server.own_topic, json.dumps(fields)) for fields in wrong]
        return [*here, (server.own_topic, "{"), (f"{TO_SERVER}{server.id + 1}", json.dumps(end))]

    disturb(server, junk, "that is not a control message for this server and episode")
