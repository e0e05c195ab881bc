"""The rules for optimization tools, in the order in which they are tried."""

from swarmwright.conformance.optimizer import (  # noqa: I001 - the order of the rules
    episodes,
    wrong_messages,
    failures,
)
from swarmwright.conformance.optimizer._tool import RULES

__all__ = ["RULES", "episodes", "failures", "wrong_messages"]
