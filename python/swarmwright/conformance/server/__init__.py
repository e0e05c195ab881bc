"""The rules for simulation servers, in the order in which they are tried."""

from swarmwright.conformance.server import (  # noqa: I001 - the order of the rules
    episodes,
    wrong_messages,
    reservation,
    presence,
    episode_extensions,
    offloaded,
    vectors,
    batches,
    connection,
)
from swarmwright.conformance.server._rules import RULES

__all__ = [
    "RULES",
    "batches",
    "connection",
    "episode_extensions",
    "episodes",
    "offloaded",
    "presence",
    "reservation",
    "vectors",
    "wrong_messages",
]
