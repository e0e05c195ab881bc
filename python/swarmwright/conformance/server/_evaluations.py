"""Offloaded evaluations for rules: controllers, requests and answers."""

from collections.abc import Mapping

import numpy as np

from swarmwright.common.json_text import Json, is_number
from swarmwright.conformance._extensions import (
    OPTIONS,
    ControllerSet,
    answer_to,
    controller_set,
    error_of,
)
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure

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
