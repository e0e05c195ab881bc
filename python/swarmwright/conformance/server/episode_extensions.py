"""S8, S14 and S15: metrics, scenes, control on the server's own topic."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmwright.common import metric_names
from swarmwright.common.json_text import Json, is_number
from swarmwright.conformance._extensions import decode_message
from swarmwright.conformance._server_under_test import Server, ServerPeer, Trajectory
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begin_episode
from swarmwright.conformance.server.wrong_messages import Junk, disturb
from swarmwright.servers.broker.client import TO_SERVER, TO_TOOL, Failure, format_payload


def names(server: Server) -> list[str]:
    """Return the announced metrics; skip the rule if there are none."""
    server.announces()
    metrics = server.announced.get("metrics")
    if not metrics:
        raise Skip("not announced: no capabilities.swarmwright.metrics")
    if not isinstance(metrics, list):
        raise Failure(f'"metrics": {metrics!r}', '"metrics" is a list of names')
    return metrics


@rule(
    "S8.1",
    "A metric's name is a letter or _, then letters, digits and _.",
    where="protocol.md, Metrics",
    fix="choose names that are valid in an expression",
    needs=["S1.2"],
)
def names_are_valid(server: Server) -> None:
    """Check the announced names."""
    wrong = [name for name in names(server) if metric_names.problem_of(str(name))]
    if wrong:
        raise Failure(f'"metrics" has {wrong[0]!r}', "names of letters, digits and _")


@rule(
    "S8.2",
    "The fitness message has all announced metrics.",
    where="protocol.md, Metrics",
    fix='send "metrics": {name: number, ...} with the fitness; omit only NaN and infinities',
    needs=["S2.3"],
)
def metrics_are_sent(server: Server) -> str:
    """Check the fitness messages of all episodes so far: a metric that never arrived is missing."""
    expected = names(server)
    trajectory = server.play()
    missing = [name for name in expected if name not in server.seen_metrics]
    wrong = [name for name in missing if name in server.wrong_metrics]
    if wrong:
        value = server.wrong_metrics[wrong[0]]
        raise Failure(f'"metrics.{wrong[0]}" is {format_payload(json.dumps(value))}', "a finite number")
    if missing:
        raise Failure(
            f"metrics {', '.join(trajectory.metrics) or 'none'} arrived",
            f"{missing[0]} as well, in some episode",
        )
    return ", ".join(expected)


SCENES = "protocol.md, Scenes"
PARTS = ["rays", "links"]
_FLOATS = {"x", "y", "radius", "heading", "value", "angle", "start", "length", "reading"}
_FINITE = {"x", "y", "radius", "angle", "start", "length"}


def skip_without_scenes(server: Server) -> None:
    """Skip the rule unless scenes are announced."""
    server.announces()
    if server.announced.get("scenes") is not True:
        raise Skip("not announced: no capabilities.swarmwright.scenes")


def watch_episode(server: Server, **fields: Any) -> tuple[Trajectory, list[Json], str]:  # noqa: ANN401 - JSON
    """Play an episode with a reply topic; return its trajectory, its scenes and the sent message."""
    episode = server.episode()
    episode.configure()
    topic = TO_TOOL + server.token
    sent = episode.start(reply=topic, **fields)
    trajectory = episode.play()
    came = [
        decode_message(message) for message in server.client.drain(server.quiet) if message.topic == topic
    ]
    return trajectory, [message for message in came if message.get("simulation_hash") == episode.hash], sent


@rule(
    "S14.1",
    "A tool that asks for scenes gets one before the first step and one after each.",
    where=f"{SCENES}; protocol/schemas/scene.schema.json",
    fix="publish scene on reply, with kind, version, server, simulation_hash and step, before the "
    "first sensor messages and after every step",
    needs=["S2.3"],
)
def sends_scene_per_step(server: Server) -> str:
    """Check that the steps of the scenes are 0, 1, 2, ..., with more scenes than turns."""
    skip_without_scenes(server)
    trajectory, scenes, sent = watch_episode(server, scenes=PARTS)
    for scene in scenes:
        for key, expected in (("kind", "scene"), ("version", 1), ("server", server.id)):
            if scene.get(key) != expected:
                raise Failure(f'"{key}" is {scene.get(key)!r}', f"{expected!r}", sent)
    steps = [scene.get("step") for scene in scenes]
    turns = max(map(len, trajectory.readings.values()), default=0)
    if steps != list(range(len(steps))) or len(steps) < turns + 1:
        few = ", ".join(map(str, steps[:20])) or "none"
        raise Failure(f"scenes of the steps {few} arrived", f"0, 1, 2, and so on, at least {turns + 1}", sent)
    return f"{len(scenes)} scenes"


@rule(
    "S14.2",
    "The arrays of a scene have matching lengths and finite numbers.",
    where=f"{SCENES}; protocol/schemas/scene.schema.json",
    fix="write bodies and rays as little-endian binary32 or unsigned 32-bit integers, one per body or ray",
    needs=["S14.1"],
)
def they_can_be_drawn(server: Server) -> None:
    """Check the arrays of the first and the last scene."""
    skip_without_scenes(server)
    _, scenes, sent = watch_episode(server, scenes=PARTS)
    if not scenes:
        raise Failure("no scene came", "one before the first step, and after each", sent)
    for scene in (scenes[0], scenes[-1]):
        for key in ("width", "height"):
            if not is_number(scene.get(key)) or scene[key] <= 0:
                raise Failure(f'"{key}" is {scene.get(key)!r}', "a number above 0", sent)
        bodies = scene.get("bodies")
        if not isinstance(bodies, Mapping):
            raise Failure(f'"bodies" is {bodies!r}', "a map", sent)
        count = len(_row(bodies, "x", None, sent))
        looks = bodies.get("looks")
        if not isinstance(looks, list) or not all(
            isinstance(look, list) and len(look) == 2 for look in looks
        ):
            raise Failure(f'"looks" is {looks!r}', "a list of pairs: kind and state", sent)
        for key in ("y", "look", "radius", "heading", "value", "agent"):
            row = _row(bodies, key, count, sent) if key in bodies or key == "y" else None
            if key == "look" and row is not None and (row >= len(looks)).any():
                raise Failure(f"look {int(row.max())}", f"an index in {len(looks)} looks", sent)
        _rays(scene.get("rays"), count, sent)


def _rays(rays: object, bodies: int, sent: str) -> None:
    if rays is None:
        return
    if not isinstance(rays, Mapping):
        raise Failure(f'"rays" is {rays!r}', "a map", sent)
    body = _row(rays, "body", None, sent)
    if (body >= bodies).any():
        raise Failure(f"a ray of body {int(body.max())}", f"an index in {bodies} bodies", sent)
    for key in ("angle", "start", "length", "reading"):
        if key in rays or key != "reading":
            _row(rays, key, len(body), sent)


def _row(part: Mapping[str, Any], key: str, count: int | None, sent: str) -> "np.ndarray[Any, Any]":
    """Return an array with this many entries. Raises Failure if it is invalid."""
    value = part.get(key)
    if not isinstance(value, bytes) or len(value) % 4:
        description = f"{len(value)} bytes" if isinstance(value, bytes) else f"{value!r:.80}"
        raise Failure(f'"{key}" is {description}', "binary, 4 bytes for each entry", sent)
    row = np.frombuffer(value, "<f4" if key in _FLOATS else "<u4")
    if count is not None and len(row) != count and not (key == "radius" and len(row) == 1):
        raise Failure(f'"{key}" has {len(row)} entries', f"{count}, one for each", sent)
    if (key in _FINITE and not np.isfinite(row).all()) or np.isinf(row).any():
        raise Failure(f'a number of "{key}" is not finite', "finite numbers", sent)
    return row


@rule(
    "S14.3",
    "Scenes change nothing else, and a tool that does not ask gets none.",
    where=SCENES,
    fix="send scenes only if control has scenes and reply; wait for nothing",
    needs=["S14.1"],
)
def nothing_else_changes(server: Server) -> None:
    """Play an episode with scenes and one without."""
    skip_without_scenes(server)
    without, unasked, sent = watch_episode(server)
    if unasked:
        raise Failure(
            f'{len(unasked)} messages, the first of the kind "{unasked[0].get("kind")}"', "none", sent
        )
    if not server.repeatable:
        raise Skip("episodes cannot be compared: two with the same actuators differ")
    trajectory, _, sent = watch_episode(server, scenes=[])
    difference = without.difference(trajectory)
    if difference:
        raise Failure(f"with scenes the episode is another one: {difference}", "the same one", sent)


WHERE = "protocol.md, Presence; decision 023"


def skip_without_topic(server: Server) -> None:
    """Skip the rule unless control messages on the server's own topic are announced."""
    server.announces()
    if server.announced.get("control") is not True:
        raise Skip("not own_topic_announced: no capabilities.swarmwright.control")


@rule(
    "S15.1",
    "A server that announces control starts an episode on a control message on its own topic.",
    where=WHERE,
    fix="handle JSON objects on swarmwright/v1/server/{server} as control; announce "
    "capabilities.swarmwright.control only then",
    needs=["S2.3"],
)
def starts(server: Server) -> None:
    """Compare an episode that was started on the own topic with one that was started on control."""
    skip_without_topic(server)
    earlier = server.trajectory
    repeatable = earlier is not None and earlier.messages > 0 and server.repeatable
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
    "Control with run: false on either topic ends an episode.",
    where=WHERE,
    fix="handle control on both topics with one function",
    needs=["S15.1", "S2.9"],
)
def ends(server: Server) -> None:
    """Start on the own topic and end on control, then the other way round."""
    skip_without_topic(server)
    for first, second in ((server.own_topic, "control"), ("control", server.own_topic)):
        episode = begin_episode(server, first)
        sent = episode.stop(second)
        try:
            server.must_come_free("free again", sent)
        except Failure:
            episode.over = False
            raise


@rule(
    "S15.3",
    "Its own topic refuses the same messages as control.",
    where=f"{WHERE}; protocol.md, Reading",
    fix="check every key of control on your own topic, including server",
    needs=["S15.1", "S2.9"],
)
def refuses(server: ServerPeer) -> None:
    """Send objects that lack a key, have a wrong type or another server or episode, or use another topic."""
    skip_without_topic(server)

    def junk(hash_: str) -> list[Junk]:
        end: Json = {"server": server.id, "simulation_hash": hash_, "run": False}
        wrong: list[Json] = [
            *({name: value for name, value in end.items() if name != key} for key in end if key != "run"),
            {**end, "server": server.id + 1},
            {**end, "server": str(server.id)},
            {**end, "simulation_hash": hash_[::-1]},
            {**end, "run": "false"},
        ]
        messages = [(server.own_topic, json.dumps(fields)) for fields in wrong]
        return [*messages, (server.own_topic, "{"), (f"{TO_SERVER}{server.id + 1}", json.dumps(end))]

    disturb(server, junk, "that is not a control message for this server and episode")
