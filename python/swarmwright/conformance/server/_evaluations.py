"""Offloaded evaluations with which rules try a server: controllers, requests and their answers."""

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
"""Parameters from here on are left out of parameter sets: in binary32 they may not be finite."""


def offered_controllers(server: Server, candidates: int = CANDIDATES) -> ControllerSet:
    """Controllers of the first kind that is announced and steers agents; a parameter set where none does."""
    server.announces(mode="offloaded")
    if server.steers_itself:
        return parameter_sets(server, candidates)
    kinds = [kind for kind in server.announced.get("controllers", []) if kind in OPTIONS]
    if not kinds:
        raise Skip("not announced: no kind of controller that the kit knows")
    return controller_set(server, kinds[0], candidates)


def request_fitness(server: Server, request: Json) -> Json:
    """The answer to a request that is to be served."""
    sent = server.request(request)
    answer = answer_to(server, request, sent, 4 * server.settings.timeout)
    kind, reason = error_of(answer)
    if kind:
        raise Failure(f'the error "{kind}" came: {reason}', "the fitness", sent)
    return answer


def must_announce_kind(server: Server, kind: str) -> None:
    """Skip the rule unless controllers of this kind are announced, and offloaded evaluation."""
    server.announces(mode="offloaded")
    if kind not in server.announced.get("controllers", []):
        raise Skip(f"not announced: capabilities.swarmwright.controllers lacks {kind!r}")


def parameter_sets(server: Server, candidates: int) -> ControllerSet:
    """Sets with the numbers among the parameters of the episodes; skips the rule where there are none.

    All candidates are the same: which other values the simulation takes is not known.
    """
    must_announce_kind(server, "parameter_set")
    values = numbers_in_parameters(server)
    if not values:
        raise Skip("give --parameters with a number, which the set can hold")
    return parameter_set_of(values, candidates)


def numbers_in_parameters(server: Server) -> dict[str, float]:
    """The numbers among the parameters of the episodes, of which a set can be made."""
    return {
        name: value
        for name, value in server.settings.parameters.items()
        if is_number(value)
        and abs(value) < _LARGEST_WEIGHT
        and name not in {"seed", "server", "simulation", "simulation_hash"}
    }


def parameter_set_of(values: Mapping[str, float], candidates: int) -> ControllerSet:
    """Parameter sets of these values, the same for all candidates."""
    types = {name: "integer" if isinstance(value, int) else "real" for name, value in values.items()}
    architecture = {
        "version": 1,
        "kind": "parameter_set",
        "parameters": [{"name": name, "type": kind} for name, kind in types.items()],
    }
    weights = np.tile(np.array(list(values.values()), dtype=np.float32), (candidates, 1))
    return ControllerSet(architecture, weights)
