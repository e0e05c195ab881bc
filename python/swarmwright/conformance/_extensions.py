"""Requests and answers of the extensions: MessagePack maps with binary arrays."""

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.json_text import Json
from swarmwright.common.random_numbers import Streams
from swarmwright.conformance._controller_kinds import OPTIONS
from swarmwright.conformance._server_under_test import Server, Steer
from swarmwright.conformance.rules import Skip
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.servers.broker.client import TO_TOOL, Failure, Message, format_payload

TOOL = "conformance/a"
OTHER = "conformance/b"
_numbers = itertools.count(1)
_MUTATIONS = 12
"""Mutations by which growing networks have grown."""


@dataclass(frozen=True)
class ControllerSet:
    """Controllers of one kind for several candidates.

    architecture: specification without weights. weights: (candidates, weights), float32.
    """

    architecture: Json
    weights: NDArray[np.float32]

    @property
    def size(self) -> int:
        """Number of weights of a candidate."""
        return int(self.weights.shape[1])

    def specification(self, candidate: int) -> Json:
        """Return the specification with the weights of a candidate."""
        return {**self.architecture, "weights": [float(str(value)) for value in self.weights[candidate]]}


def controller_set(
    server: Server,
    kind: str,
    candidates: int,
    **changes: Any,  # noqa: ANN401 - options
) -> ControllerSet:
    """Create controllers for the server, the same in every run; skip the rule if no kind fits.

    changes: options of the representation that differ from those of the kind's first trial.
    """
    component = REPRESENTATIONS.get("neat" if kind == "growing" else kind)
    values = {**OPTIONS[kind], **changes}
    if kind == "neat":
        nodes = 1 + server.actuators
        values = {"sources": [list(range(server.sensors + nodes))] * nodes, **values}
    options = component.options_model.model_validate(values)
    try:
        instance = component(options, sensors=server.sensors, actuators=server.actuators)
        genomes = instance.initials(Streams(1, "conformance", 0, range(candidates)))
        for generation in range(_MUTATIONS if kind == "growing" else 0):
            streams = Streams(1, "conformance.mutate", generation, range(candidates))
            genomes = instance.mutations(genomes, streams, severity=0.5, probability=0.5)
    except InputError as error:
        raise Skip(f"there are no such controllers here: {error}") from None
    return ControllerSet(
        instance.architecture(), np.ascontiguousarray(instance.weights(genomes), dtype=np.float32)
    )


def evaluation(server: Server, controllers: ControllerSet, seeds: Sequence[int], /, **changes: Any) -> Json:  # noqa: ANN401
    """Build a request for offloaded evaluation."""
    return {
        "kind": "evaluate",
        "version": 1,
        "request": next(_numbers),
        "tool": TOOL,
        "reply": TO_TOOL + server.token,
        "simulation": server.settings.title,
        "parameters": server.settings.parameters,
        "controller": controllers.architecture,
        "genomes": controllers.weights.astype("<f4").tobytes(),
        "seeds": np.array(seeds, dtype="<u8").tobytes(),
        "attempt": 1,
        "lease": 0.0,
    } | changes


def batch(server: Server, seeds: Sequence[int], /, **changes: Any) -> Json:  # noqa: ANN401 - JSON
    """Build a request for a batch."""
    return {
        "kind": "start",
        "version": 1,
        "request": next(_numbers),
        "tool": TOOL,
        "reply": TO_TOOL + server.token,
        "simulation": server.settings.title,
        "parameters": server.settings.parameters,
        "seeds": np.array(seeds, dtype="<u8").tobytes(),
    } | changes


def decode_message(message: Message) -> Json:
    """Decode the map in a message. Raises Failure if the payload is not a map."""
    try:
        value = msgpack.unpackb(message.payload, strict_map_key=False)
    except Exception as error:  # noqa: BLE001 - whatever the reader raises
        raise Failure(
            f"{len(message.payload)} bytes on {message.topic} that cannot be read: {error}", "MessagePack"
        ) from None
    if not isinstance(value, dict):
        raise Failure(f"{value!r} on {message.topic}", "a MessagePack map")
    return value


def answer_to(server: Server, request: Mapping[str, Any], sent: str, seconds: float | None = None) -> Json:
    """Return the next answer to a request. Raises Failure if no answer arrives or its keys are wrong."""
    limit = server.settings.timeout if seconds is None else seconds
    answer = next_answer(server, request, sent, limit)
    if answer is None:
        came = f"no answer came within {limit:g} s{server.printed}"
        raise Failure(came, f"an answer on {request['reply']}", sent)
    return answer


def next_answer(server: Server, request: Mapping[str, Any], sent: str, seconds: float) -> Json | None:
    """Return the next answer like `answer_to`; None if no answer arrives."""
    message = server.client.next(
        lambda message: (
            message.topic == TO_TOOL + server.token
            and decode_message(message).get("request") == request["request"]
        ),
        seconds,
    )
    if message is None:
        return None
    answer = decode_message(message)
    for key, expected in (("version", 1), ("server", server.id)):
        if answer.get(key) != expected:
            raise Failure(f'"{key}" is {answer.get(key)!r}', f"{expected!r}", sent)
    wanted_kind = "evaluated" if request["kind"] == "evaluate" else "sensors"
    if answer.get("kind") != wanted_kind:
        raise Failure(f'"kind" is {answer.get("kind")!r}', f'"{wanted_kind}"', sent)
    return {**answer, "correlation": message.correlation, "content_type": message.content_type}


def numbers(answer: Mapping[str, Any], key: str, kind: str) -> NDArray[Any]:
    """Return a binary array of an answer. Raises Failure if it is invalid."""
    value = answer.get(key)
    if not isinstance(value, bytes) or len(value) % np.dtype(kind).itemsize:
        raise Failure(
            f'"{key}" is {value!r}', f"MessagePack binary, a whole number of {np.dtype(kind).name} numbers"
        )
    return np.frombuffer(value, dtype=kind)


def error_of(answer: Mapping[str, Any]) -> tuple[str, str]:
    """Return kind and reason of an error; both empty if there is none. Raises Failure if it is malformed."""
    error = answer.get("error")
    if error is None:
        return "", ""
    if (
        not isinstance(error, dict)
        or not isinstance(error.get("kind"), str)
        or not isinstance(error.get("reason"), str)
    ):
        raise Failure(f'"error" is {error!r}', "{kind, reason}")
    return error["kind"], error["reason"]


def must_be_refused(
    server: Server, request: Mapping[str, Any], kinds: Sequence[str], why: str, field: str = ""
) -> str:
    """Send a request and expect an error of one of these kinds; return its reason.

    field: the invalid field, such as `controller.kind`, which reports show separately because they shorten
    requests.
    """
    sent = server.request(dict(request))
    if field:
        sent = f"{_format_field(request, field)}, in {sent}"
    kind, reason = error_of(answer_to(server, request, sent))
    if kind not in kinds:
        came = f'the error "{kind}" came: {reason}' if kind else "it was served"
        raise Failure(came, f"the error {' or '.join(kinds)}: {why}", sent)
    if not reason:
        raise Failure("received an error without a reason", "a reason that names what is wrong", sent)
    return reason


def _format_field(request: Mapping[str, Any], path: str) -> str:
    """Format a field of a request."""
    value: Any = request
    for key in path.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return f"no {path}"
        value = value[key]
    text = f"<{len(value)} bytes>" if isinstance(value, bytes) else json.dumps(value, default=str)
    return f"{path}: {format_payload(text)}"


def free_again(server: Server) -> None:
    """Release the server as `TOOL`, which has reserved it."""
    fields = {"server": server.id, "simulation_hash": TOOL, "run": False, "tool": TOOL}
    server.client.send("control", **fields)


def _values(controllers: ControllerSet, candidate: int) -> Json:
    """Return the parameters in a set, integers and real numbers (protocol.md, Parameter sets)."""
    parameters, weights = controllers.architecture["parameters"], controllers.weights[candidate]
    return {
        parameter["name"]: int(weight) if parameter["type"] == "integer" else float(str(weight))
        for parameter, weight in zip(parameters, weights, strict=True)
    }


def play_episode(server: Server, controllers: ControllerSet, candidate: int, seed: int) -> "Any":  # noqa: ANN401
    """Play the same episode stepwise, with the candidate's controllers or parameters."""
    if controllers.architecture["kind"] == "parameter_set":
        return server.play(
            parameters={**server.settings.parameters, **_values(controllers, candidate), "seed": seed}
        )
    return server.play(
        Steer(controllers.specification(candidate)), {**server.settings.parameters, "seed": seed}
    )
