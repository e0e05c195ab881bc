"""The rules for simulation servers, in the order in which they are tried."""

from swarmwright.conformance.server import (  # noqa: I001 - the order of the rules
    discovery,
    episodes,
    determinism,
    actuators,
    wrong_messages,
    reservation,
    presence,
    metrics,
    scenes,
    own_topic,
    offloaded,
    vectors,
    batches,
    connection,
    one_id,
    speed,
    shutdown,
)
from swarmwright.conformance.server._rules import RULES

__all__ = [
    "RULES",
    "actuators",
    "batches",
    "connection",
    "determinism",
    "discovery",
    "episodes",
    "metrics",
    "offloaded",
    "one_id",
    "own_topic",
    "presence",
    "reservation",
    "scenes",
    "shutdown",
    "speed",
    "vectors",
    "wrong_messages",
]
