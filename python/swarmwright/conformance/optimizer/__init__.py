"""The rules for optimization tools, in the order in which they are tried."""

from swarmwright.conformance.optimizer import (  # noqa: I001 - the order of the rules
    episodes,
    wrong_messages,
    failures,
    extensions,
    ending,
)
from swarmwright.conformance.optimizer._rules import RULES

__all__ = [
    "RULES",
    "ending",
    "episodes",
    "extensions",
    "failures",
    "wrong_messages",
]
