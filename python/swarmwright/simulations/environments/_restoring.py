"""Whether `reset` brings an environment back to where it was, which one object for all episodes needs.

Some environments keep contacts, lists or running means over `reset`. What happens in an episode would then
depend on the episodes before, and so on which server has evaluated which candidate.
"""

import contextlib
import hashlib
import time
from collections.abc import Callable, Iterator
from enum import Enum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 200
"""Steps of a trial, at most. Those of BipedalWalker-v3 differ once it has fallen, those of
knights_archers_zombies once a zombie has got through, after 141."""
SECONDS = 5.0
"""Time of all trials together, after which they end with what is known: servers have to begin their work."""
_SEEDS = (1, 2)
"""Seeds of the episode that is repeated, and of the one between: some environments take 0 for no seed."""

Actions = Callable[[int], NDArray[np.float64]]
"""Number of actuators -> what they do in a step, -1 to 1."""
Trial = Callable[[Any, int, Actions], Iterator[bytes]]
"""(environment, seed, actions) -> what an episode returns, step after step."""


class Restoring(Enum):
    """What trials have shown."""

    RESTORED = auto()
    """An episode with the same seed and actions is the same again."""
    NEW_ONLY = auto()
    """It is the same in a new object only."""
    NEVER = auto()
    """It differs even in a new object: not all randomness comes from the seed."""
    UNKNOWN = auto()
    """There was not enough time to find out."""


class _OutOfTimeError(Exception):
    """The time of the trials is over."""


def found_by_trials(make: Callable[[], Any], trial: Trial) -> Restoring:
    """Compare an episode with its repetition after another one, to the bit.

    Only new objects are used, so that the ones that evaluate are what they are without the comparison.

    Args:
        make: returns a new environment.
        trial: runs an episode.
    """
    end = time.monotonic() + SECONDS
    repeated, between = _SEEDS
    env = make()
    try:
        first = _record(env, trial, repeated, end)
        _record(env, trial, between, end)
        if _record(env, trial, repeated, end) == first:
            return Restoring.RESTORED
    except _OutOfTimeError:
        return Restoring.UNKNOWN
    finally:
        close(env)
    env = make()
    try:
        return Restoring.NEW_ONLY if _record(env, trial, repeated, end) == first else Restoring.NEVER
    except _OutOfTimeError:
        return Restoring.NEW_ONLY  # it is known that `reset` is not enough
    finally:
        close(env)


def _record(env: Any, trial: Trial, seed: int, end: float) -> list[bytes]:  # noqa: ANN401 - of libraries
    """Return digests of what an episode returns, step after step.

    One that fails ends with the exception, which episodes report.

    Raises _OutOfTimeError after `end`, a time of `time.monotonic`.
    """
    generator = np.random.default_rng(seed)

    def actions(width: int) -> NDArray[np.float64]:
        return np.zeros(width) if seed == _SEEDS[0] else generator.uniform(-1, 1, width)

    returned = []
    try:
        for _, one in zip(range(STEPS + 1), trial(env, seed, actions), strict=False):
            returned.append(hashlib.sha256(one).digest())  # observations can be pictures
            if time.monotonic() > end:
                raise _OutOfTimeError
    except _OutOfTimeError:
        raise
    except Exception as error:  # noqa: BLE001 - libraries raise various exceptions
        returned.append(type(error).__name__.encode())
    return returned


def close(env: Any) -> None:  # noqa: ANN401 - types of libraries
    """Close an environment; what it has computed counts also where it has no `close`, or that fails."""
    with contextlib.suppress(Exception):
        env.close()
