"""The rules for simulation servers, in the order in which they are tried."""

from swarmwright.conformance.server import (  # noqa: I001 - the order of the rules
    discovery,
    episodes,
    same_again,
    actuators,
    wrong_messages,
    taken,
    presence,
    metrics,
    offloaded,
    vectors,
    batches,
    connection,
    speed,
    leaving,
)
from swarmwright.conformance.server._rules import RULES

__all__ = [
    "RULES",
    "actuators",
    "batches",
    "connection",
    "discovery",
    "episodes",
    "leaving",
    "metrics",
    "offloaded",
    "presence",
    "same_again",
    "speed",
    "taken",
    "vectors",
    "wrong_messages",
]
