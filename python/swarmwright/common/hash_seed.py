"""Python's hash seed, on which the order of sets of texts depends: PYTHONHASHSEED.

Each process of Python has another one by default, so that a simulation that iterates over a set computes
something else in each. Processes that Swarmwright starts have the same one.
"""

import os
import sys
from collections.abc import Mapping

VARIABLE = "PYTHONHASHSEED"
_FIXED = "0"
"""The seed of processes that are started, unless the environment names one."""
RANDOM = "random"


def of_started(environment: Mapping[str, str] = os.environ) -> str:
    """Return the hash seed of processes that are started in an environment."""
    given = environment.get(VARIABLE, "")
    return _FIXED if given in {"", RANDOM} else given


def of_this_process() -> str:
    """Return the hash seed of this process; `random` where it is not known."""
    if sys.flags.ignore_environment:
        return RANDOM
    return os.environ.get(VARIABLE) or RANDOM if sys.flags.hash_randomization else _FIXED


def variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment variable by which a process has the seed of `of_started`."""
    return {VARIABLE: of_started(environment)}
