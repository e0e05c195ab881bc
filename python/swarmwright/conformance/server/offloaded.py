"""S9: offloaded evaluation."""

import math
import time
from collections.abc import Mapping

import msgpack
import numpy as np
from numpy.typing import NDArray

from swarmwright.common.json_text import Json, is_number
from swarmwright.common.random_numbers import Streams
from swarmwright.conformance._controller_kinds import OPTIONS, REAL_KINDS, TRIALS, Trial
from swarmwright.conformance._extensions import (
    OTHER,
    TOOL,
    ControllerSet,
    answer_to,
    controller_set,
    decode_message,
    error_of,
    evaluation,
    free_again,
    must_be_refused,
    numbers,
    play_episode,
)
from swarmwright.conformance._server_under_test import Server, Trajectory, is_same_fitness
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import begin_episode
from swarmwright.conformance.server.reservation import must_be_taken
from swarmwright.servers.broker.client import Failure, format_payload

NUMBERS = "protocol.md, Messages of numbers"
SEEDS = (3, 1)
"""Simulation seeds of the episodes of a request."""
CANDIDATES = 3
"""Candidates of a request."""
_LARGEST_WEIGHT = 1e38
"""Parameters of at least this size are excluded from parameter sets: they may overflow binary32."""


def list_controllers(server: Server, candidates: int = CANDIDATES) -> ControllerSet:
    """Create controllers of the first announced kind that steers agents, or else a parameter set."""
    server.announces(mode="offloaded")
    if server.steers_itself:
        return parameter_sets(server, candidates)
    kinds = [kind for kind in server.announced.get("controllers", []) if kind in OPTIONS]
    if not kinds:
        raise Skip("not announced: no kind of controller that the kit knows")
    return controller_set(server, kinds[0], candidates)


def request_fitness(server: Server, request: Json) -> Json:
    """Send a valid request; return the answer."""
    sent = server.request(request)
    answer = answer_to(server, request, sent, 4 * server.settings.timeout)
    kind, reason = error_of(answer)
    if kind:
        raise Failure(f'the error "{kind}" came: {reason}', "the fitness", sent)
    return answer


def must_announce_kind(server: Server, kind: str) -> None:
    """Skip the rule unless offloaded evaluation and controllers of this kind are announced."""
    server.announces(mode="offloaded")
    if kind not in server.announced.get("controllers", []):
        raise Skip(f"not announced: capabilities.swarmwright.controllers lacks {kind!r}")


def parameter_sets(server: Server, candidates: int) -> ControllerSet:
    """Create sets of the numeric parameters of the episodes; skip the rule if there are none.

    All candidates are equal, because other valid values are unknown.
    """
    must_announce_kind(server, "parameter_set")
    values = numbers_in_parameters(server)
    if not values:
        raise Skip("give --parameters with a number, which the set can hold")
    return parameter_set_of(values, candidates)


def numbers_in_parameters(server: Server) -> dict[str, float]:
    """Return the numeric parameters of the episodes that a set can contain."""
    return {
        name: value
        for name, value in server.settings.parameters.items()
        if is_number(value)
        and abs(value) < _LARGEST_WEIGHT
        and name not in {"seed", "server", "simulation", "simulation_hash"}
    }


def parameter_set_of(values: Mapping[str, float], candidates: int) -> ControllerSet:
    """Create parameter sets of these values, equal for all candidates."""
    types = {name: "integer" if isinstance(value, int) else "real" for name, value in values.items()}
    architecture = {
        "version": 1,
        "kind": "parameter_set",
        "parameters": [{"name": name, "type": kind} for name, kind in types.items()],
    }
    weights = np.tile(np.array(list(values.values()), dtype=np.float32), (candidates, 1))
    return ControllerSet(architecture, weights)


NORMAL = "normal"
ROWS = ("center", "deviation", "middle", "reach", "lower", "upper")


def makes_samples(server: Server, architecture: Json) -> bool:
    """Return whether the server announces that it creates such genomes from samples."""
    announced = server.announced.get("distributions")
    return isinstance(announced, list) and NORMAL in announced and architecture.get("kind") in REAL_KINDS


def sample_of(weights: int, candidates: int) -> Json:
    """Build a sample of this many candidates, with some weights at their bounds."""
    genes = np.arange(weights)
    rows = {
        "center": np.sin(genes),
        "deviation": 0.25 + 0.5 * (genes % 3),
        "middle": 0.1 * (genes % 2),
        "reach": np.full(weights, 1.5),
        "lower": np.full(weights, -1.25),
        "upper": np.full(weights, 1.0),
    }
    return {
        "distribution": NORMAL,
        "seed": 5,
        "purpose": "conformance.sample",
        "generation": 2,
        # Begin with the second candidate of a pair.
        "first": 3,
        "count": candidates,
        "mirrored": True,
        **{name: row.astype("<f8").tobytes() for name, row in rows.items()},
    }


def genomes_of(sample: Json) -> NDArray[np.float32]:
    """Return the genomes of a mirrored sample (protocol.md, Samples), (count, weights)."""
    center, deviation, middle, reach, lower, upper = (np.frombuffer(sample[name], "<f8") for name in ROWS)
    candidates = np.arange(sample["first"], sample["first"] + sample["count"])
    streams = Streams(sample["seed"], sample["purpose"], sample["generation"], (candidates // 2).tolist())
    away = deviation * streams.normals(len(center)).astype(np.float64)
    point = np.where(candidates[:, None] % 2, center - away, center + away)
    genomes: NDArray[np.float32] = np.clip(middle + reach * point, lower, upper).astype(np.float32)
    return genomes


def wrong_samples(weights: int, candidates: int) -> list[tuple[str, Json]]:
    """Return invalid samples, each with the name of its invalid field."""
    sound = sample_of(weights, candidates)
    nan = np.full(weights, np.nan).tobytes()
    changed = {
        "distribution": "abacus",
        "reach": sound["reach"][:-8],
        "deviation": nan,
        "upper": np.full(weights, 1e39).tobytes(),
        "first": 2**64 - 1,
        "count": 2**32,
    }
    wrong = [(f"sample.{field}", {**sound, field: value}) for field, value in changed.items()]
    missing = {key: value for key, value in sound.items() if key != "center"}
    return [*wrong, ("sample.center", missing), ("sample.center", sample_of(weights + 1, candidates))]


OFFLOADED = "protocol.md, Offloaded evaluation"
LONG_REQUEST_S = 0.5
"""Duration of a request in seconds that suffices for any other request to arrive meanwhile."""
_MOST_REPETITIONS = 1 << 16
"""Largest number of repetitions of a request's controllers that keep a server busy."""


@rule(
    "S9.1",
    "evaluated has the fitness of every candidate and episode, row by row; an announced "
    "distribution's sample counts as its genomes.",
    where=f"{OFFLOADED}; protocol.md, Samples; protocol/schemas/evaluated.schema.json",
    fix="publish evaluated on reply: request, server, fitness (candidates, episodes) as binary64, "
    "seconds; if you announce distributions, replay protocol/vectors/samples.json",
    needs=["S2.3"],
)
def is_answered(server: Server) -> None:
    """Evaluate three candidates in two episodes, then a sample of three and its genomes."""
    controllers = list_controllers(server)
    _finite(server, evaluation(server, controllers, SEEDS))
    if not makes_samples(server, controllers.architecture):
        return
    sample = sample_of(controllers.weights.shape[1], CANDIDATES)
    same_controllers = ControllerSet(controllers.architecture, genomes_of(sample))
    expected = _finite(server, evaluation(server, same_controllers, SEEDS))
    fitness = _finite(server, evaluation(server, controllers, SEEDS, genomes=b"", sample=sample))
    if server.deterministic is not False and fitness.tobytes() != expected.tobytes():
        raise Failure(
            f"fitness {fitness.tolist()} of a sample",
            f"{expected.tolist()}, that of its genomes",
            f"evaluate with the sample {format_payload(str(sample))}",
        )


def _finite(server: Server, request: Json) -> NDArray[np.float64]:
    """Return the fitness of three candidates in two episodes. Raises Failure if it is not finite."""
    answer = request_fitness(server, request)
    fitness = numbers(answer, "fitness", "<f8")
    if len(fitness) != CANDIDATES * len(SEEDS):
        raise Failure(
            f"{len(fitness)} numbers",
            f"{CANDIDATES * len(SEEDS)}: {CANDIDATES} candidates, {len(SEEDS)} episodes",
        )
    if not np.isfinite(fitness).all():
        raise Failure(
            f'fitness {list(fitness)}, "failed": {answer.get("failed")}', "finite numbers, nothing failed"
        )
    seconds = answer.get("seconds")
    if not isinstance(seconds, float | int) or not 0 <= seconds < math.inf:
        raise Failure(f'"seconds" is {seconds!r}', "a number from 0")
    return fitness


@rule(
    "S9.2",
    "With MQTT 5 an answer has the request's correlation data and the content type application/msgpack.",
    where=NUMBERS,
    fix="set ContentType, and CorrelationData to the request's number (8 bytes, big-endian)",
    needs=["S9.1"],
)
def properties(server: Server) -> None:
    """Check the properties of an answer; MQTT 3.1.1 has none."""
    request = evaluation(server, list_controllers(server), [1])
    answer = request_fitness(server, request)
    if answer["correlation"] is None and answer["content_type"] is None:
        raise Skip("the server speaks MQTT 3.1.1, which has no properties")
    correlation = request["request"].to_bytes(8, "big")
    if answer["correlation"] != correlation or answer["content_type"] != "application/msgpack":
        raise Failure(
            f"{answer['correlation']!r} and {answer['content_type']!r}",
            f"{correlation!r} and 'application/msgpack'",
        )


def _must_have_stepwise_fitness(server: Server, controllers: ControllerSet) -> str:
    """Raise Failure unless all candidates have their stepwise fitness; return how many values differ."""
    fitness = numbers(request_fitness(server, evaluation(server, controllers, SEEDS)), "fitness", "<f8")
    free_again(server)
    for candidate in range(CANDIDATES):
        for episode, seed in enumerate(SEEDS):
            trajectory: Trajectory = play_episode(server, controllers, candidate, seed)
            value = float(fitness[candidate * len(SEEDS) + episode])
            if not is_same_fitness(trajectory.fitness, value):
                raise Failure(
                    f"candidate {candidate}, seed {seed}: {value!r} offloaded, {trajectory.fitness!r} "
                    "stepwise",
                    "the same bits",
                    f"evaluate with {CANDIDATES} controllers {controllers.architecture}",
                )
    return f"{len(set(fitness.tolist()))} different values"


def _register(trial: Trial) -> None:
    @rule(
        trial.rule,
        f"{trial.title} give their stepwise fitness, to the last bit.",
        where="decision 002",
        fix=f"{trial.advice}; replay protocol/vectors/controllers.json",
        needs=["S9.1", "S3.2"],
    )
    def _equals_stepwise(server: Server) -> str:
        """Evaluate three candidates with two seeds."""
        must_announce_kind(server, trial.kind)
        server.comparable()
        _ = server.reference
        controllers = controller_set(server, trial.kind, CANDIDATES, **trial.options)
        return _must_have_stepwise_fitness(server, controllers)


for _trial in TRIALS:
    _register(_trial)


@rule(
    "S9.6",
    "A parameter set is refused as invalid if the simulation asks for actuators, else it gives the "
    "stepwise fitness.",
    where="protocol.md, Controllers",
    fix="answer error invalid if the simulation asks an agent that has no controller",
    needs=["S2.3"],
)
def parameter_set(server: Server) -> str | None:
    """Evaluate a set of the episodes' numeric parameters, or of an unknown name."""
    if not server.steers_itself:
        must_announce_kind(server, "parameter_set")
        numbers_given = numbers_in_parameters(server) or {"conformance": 1}
        request = evaluation(server, parameter_set_of(numbers_given, 1), [1])
        must_be_refused(server, request, ["invalid"], "agents without a controller are asked")
        return None
    controllers = parameter_sets(server, CANDIDATES)
    if server.deterministic is False:
        request_fitness(server, evaluation(server, controllers, SEEDS))
        return None
    return _must_have_stepwise_fitness(server, controllers)


@rule(
    "S9.7",
    "Exactly the requested metrics come back, with their stepwise bits.",
    where="protocol.md, Metrics",
    fix="send metrics {name: binary64 (candidates, episodes)} for the requested names",
    needs=["S9.1", "S3.2"],
)
def metrics(server: Server) -> str:
    """Request no metrics, an unknown one, one, and all."""
    controllers = list_controllers(server, 1)
    announced = server.announced.get("metrics") or []
    answer = request_fitness(server, evaluation(server, controllers, [1]))
    if answer.get("metrics"):
        raise Failure(f"metrics {sorted(answer['metrics'])} arrived", "none, for none were asked for")
    unknown = evaluation(server, controllers, [1], metrics=["no_such_metric"])
    must_be_refused(server, unknown, ["invalid"], "there is no such metric")
    if not announced:
        raise Skip("not announced: no capabilities.swarmwright.metrics")
    answers = {}
    for requested in ([announced[-1]], list(announced)):
        answer = request_fitness(server, evaluation(server, controllers, [1], metrics=requested))
        returned = answer.get("metrics")
        if not isinstance(returned, dict) or sorted(returned) != sorted(requested):
            raise Failure(f"metrics {sorted(returned or {})} arrived", f"{sorted(requested)}, as asked for")
        answers = {name: float(numbers(returned, name, "<f8")[0]) for name in requested}
    free_again(server)
    server.comparable()
    trajectory: Trajectory = play_episode(server, controllers, 0, 1)
    for name, value in answers.items():
        stepwise = trajectory.metrics.get(name)
        if stepwise is not None and not is_same_fitness(stepwise, value):
            raise Failure(f"{name} is {value!r} offloaded, {stepwise!r} stepwise", "the same bits")
    return ", ".join(answers)


@rule(
    "S9.8",
    "Requests of one tool are answered in their order.",
    where=OFFLOADED,
    fix="queue requests during a computation",
    needs=["S9.1"],
)
def answers_in_order(server: Server) -> None:
    """Send five requests at once."""
    controllers = list_controllers(server)
    requests = [evaluation(server, controllers, SEEDS) for _ in range(5)]
    sent = ""
    for request in requests:
        sent = server.request(request)
    heard: list[object] = []
    for _ in requests:
        message = server.client.next(
            lambda message: message.topic.endswith(server.token), 4 * server.settings.timeout
        )
        if message is None:
            raise Failure(f"{len(heard)} answers came{server.printed}", f"{len(requests)} answers", sent)
        heard.append(decode_message(message).get("request"))
    if heard != [request["request"] for request in requests]:
        raise Failure(f"answers {heard}", f"answers {[request['request'] for request in requests]}", sent)


@rule(
    "S9.9",
    "A reserved server does not answer discovery and refuses other requests as taken; a free one "
    "refuses requests for another instance.",
    where="protocol.md, Messages of numbers; protocol.md, Two servers with one ID",
    fix="reserve on evaluate as on control with a tool, and for 5 s afterwards; compare instance, if "
    "present, with yours",
    needs=["S9.1", "S2.9"],
)
def is_held_for_tool(server: Server) -> None:
    """Check that an evaluation reserves the server for its tool until run: false.

    Then send requests for another instance and for this one.
    """
    controllers = list_controllers(server)
    request_fitness(server, evaluation(server, controllers, [1]))
    must_be_taken(server, f"it is held for {TOOL}", "evaluate")
    reason = evaluation(server, controllers, [1], tool=OTHER)
    must_be_refused(server, reason, ["taken"], f"it is held for {TOOL}")
    request_fitness(server, evaluation(server, controllers, [1]))
    free_again(server)
    server.must_answer("an answer to every tool", f'control with run: false and "tool": "{TOOL}"')
    if instance := server.instance:
        other = evaluation(server, controllers, [1], instance=f"not {instance}")
        must_be_refused(server, other, ["taken"], "another instance of the server is meant")
        request_fitness(server, evaluation(server, controllers, [1], instance=instance))


@rule(
    "S9.10",
    "During another tool's episode, evaluate is refused as taken, and the episode continues.",
    where="protocol.md, Messages of numbers",
    fix="answer error taken at once; leave the simulation alone",
    needs=["S9.1", "S2.9"],
)
def refuses_during_episode(server: Server) -> None:
    """Request an evaluation in the middle of an episode."""
    controllers = list_controllers(server)
    episode = begin_episode(server)
    must_be_refused(server, evaluation(server, controllers, [1]), ["taken"], "an episode is under way")
    trajectory = episode.play()
    difference = server.reference.difference(trajectory) if server.deterministic else ""
    if difference:
        raise Failure(
            difference,
            "the episode as if nothing had arrived in between",
            "evaluate in the middle of an episode",
        )


@rule(
    "S9.11",
    "Invalid requests are answered with error invalid, which names the field.",
    where=NUMBERS,
    fix="check every field before you compute; answer {kind: invalid, reason}",
    needs=["S9.1"],
)
def invalid(server: Server) -> None:
    """Send requests in which one field of evaluate, or of its sample, is invalid."""
    controllers = list_controllers(server)
    architecture = controllers.architecture
    misfits: list[tuple[str, Json]]
    if server.steers_itself:
        misfits = [("controller.parameters", {"parameters": "conformance"})]
    else:
        misfits = [
            ("controller.sensors", {"sensors": server.sensors + 1}),
            ("controller.actuators", {"actuators": server.actuators + 1}),
        ]
    # If candidates have a single number, any number of values is a whole number of candidates.
    short = [("genomes", {"genomes": controllers.weights.tobytes()[:-4]})] if controllers.size > 1 else []
    wrong: list[tuple[str, Json]] = [
        ("version", {"version": 2}),
        ("simulation", {"simulation": "no such simulation"}),
        ("controller.kind", {"controller": {**architecture, "kind": "abacus"}}),
        *((field, {"controller": {**architecture, **changes}}) for field, changes in misfits),
        *short,
        ("genomes", {"genomes": controllers.weights.tobytes()[:-1]}),
        ("genomes", {"genomes": np.full_like(controllers.weights, np.nan).tobytes()}),
        ("genomes", {"genomes": controllers.weights.tolist()}),
        ("seeds", {"seeds": b""}),
        ("parameters", {"parameters": [1]}),
    ]
    for field, changes in wrong:
        request = evaluation(server, controllers, [1], **changes)
        must_be_refused(server, request, ["invalid"], f"{field} is wrong", field)
    for field in ("controller", "genomes", "seeds", "simulation"):
        request = evaluation(server, controllers, [1])
        del request[field]
        must_be_refused(server, request, ["invalid"], f"{field} is missing", field)
    if makes_samples(server, architecture):
        weights = controllers.weights.shape[1]
        for field, sample in wrong_samples(weights, CANDIDATES):
            request = evaluation(server, controllers, [1], genomes=b"", sample=sample)
            must_be_refused(server, request, ["invalid"], f"{field} is wrong", field)
        request = evaluation(server, controllers, [1], sample=sample_of(weights, CANDIDATES))
        must_be_refused(server, request, ["invalid"], "there are genomes and a sample", "sample")
    request_fitness(server, evaluation(server, controllers, [1]))


@rule(
    "S9.12",
    "Other payloads and unknown keys are ignored, and it answers only on topics of tools.",
    where=NUMBERS,
    fix="refuse all but MessagePack maps of a known kind; check that reply begins with swarmwright/v1/tool/",
    needs=["S9.1"],
)
def ignores_junk(server: Server) -> None:
    """Send junk, an unknown kind and a reply topic that is not a tool's, then a request with unknown keys."""
    controllers = list_controllers(server)
    topic = f"swarmwright/v1/server/{server.id}"
    for payload in (
        b"",
        b"\xc1",
        b"{}",
        b"\x81\xa4kind",
        msgpack.packb([1, 2]),
        msgpack.packb({"kind": "dance", "version": 1}),
    ):
        server.client.publish(topic, payload)
    elsewhere = f"conformance/{server.token}"
    sent = server.request(evaluation(server, controllers, [1], reply=elsewhere))
    request = evaluation(server, controllers, [1], note={"deep": [1, None]})
    server.request(request)
    strays = []

    def is_answer(message: object) -> bool:
        name = getattr(message, "topic", "")
        if name == elsewhere:
            strays.append(message)
        return str(name).endswith(server.token) and name != elsewhere

    if server.client.next(is_answer, 2 * server.settings.timeout) is None:
        raise Failure(
            f"no answer came{server.printed}",
            "an answer to the sound request that followed",
            "junk, then a request with unknown keys",
        )
    if strays:
        raise Failure(f"an answer on {elsewhere} arrived", "answers on swarmwright/v1/tool/... only", sent)


@rule(
    "S9.13",
    "A request whose lease ends in the queue is answered with error failed, not computed.",
    where=OFFLOADED,
    fix="note when a request arrived; check its lease at its turn",
    needs=["S9.8"],
    seconds=60,
)
def lease_ends(server: Server) -> None:
    """Send a long request, and behind it one with a lease of one microsecond.

    The first request grows until the second has to wait for it. The largest, or one that takes long, is sent
    three times, since on a busy machine the second may arrive after the first is done.
    """
    small = list_controllers(server)
    times, left = 16, 3
    while left:
        copies = min(times, 1024)
        large = ControllerSet(small.architecture, np.tile(small.weights, (copies, 1)))
        first = evaluation(server, large, range(times // copies))
        second = evaluation(server, small, [1], lease=1e-6)
        server.request(first)
        sent = server.request(second)
        start = time.monotonic()
        answer_to(server, first, sent, 20 * server.settings.timeout)
        seconds = time.monotonic() - start
        kind, _ = error_of(answer_to(server, second, sent, 4 * server.settings.timeout))
        if kind == "failed":
            return
        if seconds > LONG_REQUEST_S or times == _MOST_REPETITIONS:
            left -= 1
        else:
            times *= 4
    came = f'the error "{kind}" came' if kind else "it was computed"
    raise Failure(came, 'the error "failed": its lease was over when its turn came', sent)
